"""Processes that are restarted, interrupted, killed or slow: what they keep and say."""

import asyncio
import fcntl
import json
import os
import pty
import signal
import subprocess
import sys
import termios
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from functools import partial
from itertools import cycle, product
from pathlib import Path
from threading import Event, Thread

import pytest

from checks.faults.restarts import NO_PAUSE, ArrivalTimes, kept_stops, running
from checks.harness.crew import (
    Crew,
    Witness,
    alive,
    children_of,
    cmdline,
    departs,
    frames_in,
    real_time,
)
from checks.harness.observer import is_still
from checks.harness.operator import ThreadedOperator
from checks.harness.processes import Running
from checks.harness.until import PATIENCE_S, until
from ground.cli.run.up import goal_runs_of
from ground.client.goal import destination
from ground.client.outcomes import Refused
from ground.commands.arm import Arm
from ground.commands.goto import Goto
from ground.commands.pose import SetTruePose
from ground.commands.stop import ClearEmergencyStop, StopNow
from ground.launch import child_command
from ground.launch.child_command import command
from ground.launch.child_processes import ChildExitError
from ground.launch.fleet_run import FleetRun
from ground.launch.launcher import Stack
from ground.launch.scenario import CLOCKS, WALL
from ground.launch.supervisor import RestartPolicy
from ground.text.output import Output
from protocol.bus.bus import open_bus
from protocol.topics import Role
from protocol.wire.enums import GoalState, Vehicle
from protocol.wire.reasons import Reason
from runtime.clock import WallClock
from runtime.units import NS_PER_MS as MS
from runtime.watchdog import HANGS
from tests.support.spoilt import Sabotage

pytestmark = pytest.mark.stack

STOPPED_MS = 200 + 50  # the truth comes once in a period
HUNG = {"paced": "hung (silent for 4.5 s)", WALL: "hung (silent for 2.5 s)"}
KILLED = "was killed (signal SIGKILL)"
HEALED_S = 60.0
ROUND_S = 0.02  # `up` looks more often, but each round costs processor time
DRIVES_S = 60.0
HOWS = ("SIGKILL", "SIGSTOP", "holds the lock")


@pytest.fixture
def sabotage(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Sabotage:
    """Provide sabotage for every process that is started here."""
    found = Sabotage(tmp_path)
    monkeypatch.setattr(child_command, "START", found.start)
    return found


@contextmanager
def operating(stack: Stack) -> Iterator[ThreadedOperator]:
    """Yield an operator of the robot of a stack."""
    with (
        open_bus(stack.common.network, Role.GROUND, stack.common.robot) as bus,
        ThreadedOperator(bus, stack.common.robot) as operator,
    ):
        yield operator


class Stage:
    """A stack that is looked after, and a witness."""

    def __init__(self, stack: Stack, ears: ArrivalTimes, witness: Witness) -> None:
        self.stack, self.ears, self.witness = stack, ears, witness
        self.told: list[str] = []

    def look(self) -> None:
        """Run one round of supervision, as `up` does."""
        self.stack.check()
        while news := self.stack.next_event():
            self.told.append(news)

    def until(self, condition: Callable[[], object], what: str) -> None:
        def there() -> bool:
            self.look()
            return bool(condition())

        until(there, within_s=HEALED_S, what=what, poll_s=ROUND_S)

    def drive(self) -> None:
        """Armed, on its way; on a busy machine it may stop for its budget, and is sent again."""
        hears, witness = self.stack._bus, self.witness
        assert hears is not None
        says, clock = Output(as_json=False), WallClock()
        goal_runs = goal_runs_of(self.stack, hears, says, clock, drives=True)
        fleet_run = FleetRun(goal_runs, clock, self.look, lambda _: None)
        for pid in children_of(os.getpid()):
            real_time(pid)
        deadline_s = time.monotonic() + DRIVES_S
        while time.monotonic() < deadline_s:
            asyncio.run(fleet_run.launch(lockstep=False))
            stopped = len(witness.statuses)
            self.until(partial(self.under_way, stopped), "driving")
            if self.moves():
                return
        raise AssertionError(f"stopped by itself for {DRIVES_S:g} s")

    def set_true_place(self) -> None:
        """Require that the robot refuses a goal for its unknown place, and give it the true one."""
        self.until(lambda: self.said("PLACE UNKNOWN"), "the loss of the place")
        with operating(self.stack) as operator:
            refused = operator.perform(Goto(goal=destination([1.0, 1.0]), wait=False))
            assert isinstance(refused, Refused)
            assert refused.reason == Reason.PLACE_UNKNOWN
            assert operator.perform(SetTruePose()).ok

    def under_way(self, before: int) -> bool:
        return self.moves() or self.failed(before)

    def moves(self) -> bool:
        return self.witness.truth.speed_m_s > 0.25

    def failed(self, before: int) -> bool:
        """Has it been in failsafe since it was sent?"""
        since = tuple(self.witness.statuses)[before:]
        return any(status.vehicle == Vehicle.FAILSAFE for status, _ in since)

    def hurt(self, role: str, how: str, sabotage: Sabotage) -> int:
        """Kill it, stop it, or let it hang with Python's lock held; when that was."""
        self.told.clear()
        self.witness.texts.clear()
        if how == "holds the lock":
            sabotage.hang(role.partition(" ")[0])
        else:
            self.stack._children.send(role, signal.Signals[how])
        return WallClock().now_ns()

    def said(self, *pieces: str) -> bool:
        """Return whether the robot sent this text; it arrives in pieces of 50 bytes."""
        return all(piece in "".join(self.witness.texts) for piece in pieces)

    def said_why(self, role: str, cause: str, how: str) -> bool:
        """Return whether the robot and the supervisor told why the process of a role ended.

        A process that holds the lock also ends itself, which a busy machine may do first.
        """
        causes = (cause, HANGS) if how == "holds the lock" else (cause,)
        for one in causes:
            if self.told == [f"the {role} process {one}; restarting"]:
                is_robot = role.startswith("robot")
                return not is_robot or self.said("restarted: the previous run", one)
        return False


@contextmanager
def stage_of(
    *, router: bool, policy: RestartPolicy = NO_PAUSE, clock_name: str = WALL
) -> Iterator[Stage]:
    with ExitStack() as scope:
        run = running(router=router, policy=policy, clock_name=clock_name)
        stack, ears, _ = scope.enter_context(run)
        witness = scope.enter_context(Witness(stack.common.endpoint))
        witness.ready()
        yield Stage(stack, ears, witness)


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    """Try each way with one clock, and with `--examples long` with both."""
    if "how" in metafunc.fixturenames:
        cases = list(product(HOWS, CLOCKS))
        if metafunc.config.getoption("--examples") != "long":
            cases = [*zip(HOWS, cycle(CLOCKS), strict=False)]
        metafunc.parametrize(("how", "clock_name"), cases)


def test_robot_plant_and_router_come_back_one_after_the_other(
    how: str, clock_name: str, sabotage: Sabotage
) -> None:
    cause = KILLED if how == "SIGKILL" else HUNG[clock_name]
    with stage_of(router=True, clock_name=clock_name) as stage:
        a_robot_that_was_stopped_comes_back_stopped(stage, how, cause, sabotage)
        the_robot_comes_back_disarmed(stage, how, cause, sabotage)
        without_its_plant_the_robot_stays_where_it_is(stage, how, cause, sabotage)
        the_others_find_the_router_again(stage, how, cause, sabotage)


def the_robot_comes_back_disarmed(stage: Stage, how: str, cause: str, sabotage: Sabotage) -> None:
    witness = stage.witness
    stage.drive()
    stage.hurt("robot r1", how, sabotage)
    stage.until(witness.standing, "standing")
    assert witness.rolled_on_ms() <= STOPPED_MS
    stage.until(lambda: stage.said_why("robot r1", cause, how), "the cause")
    stage.until(lambda: witness.status.vehicle == Vehicle.STANDBY, "STANDBY")
    assert witness.status.goal == GoalState.NONE
    seen = len(witness.truths)
    stage.until(lambda: len(witness.truths) > seen + 10, "half a second of truth")
    assert all(is_still(truth) for truth, _ in tuple(witness.truths)[seen:])
    stage.set_true_place()


def without_its_plant_the_robot_stays_where_it_is(
    stage: Stage, how: str, cause: str, sabotage: Sabotage
) -> None:
    """Require FAILSAFE although the sensors are back, because the position is lost."""
    witness = stage.witness
    stage.drive()
    stage.hurt("plant", how, sabotage)
    stage.until(lambda: witness.status.vehicle == Vehicle.FAILSAFE, "FAILSAFE")
    assert witness.status.vehicle_reason == Reason.TICKS_LOST
    stage.until(lambda: stage.said("position lost: sensor stream restarted"), "its words")
    assert stage.said_why("plant", cause, how), stage.told
    assert witness.status.vehicle == Vehicle.FAILSAFE
    assert witness.status.goal == GoalState.ABORTED
    assert witness.speeds == (0, 0)


def the_others_find_the_router_again(
    stage: Stage, how: str, cause: str, sabotage: Sabotage
) -> None:
    """A router that holds Python's lock still routes: routing runs outside of Python."""
    hurt_ns = stage.hurt("router", how, sabotage)
    until_ns = hurt_ns + (4_000 if how == "holds the lock" else 100) * MS
    stage.until(lambda: stage.ears.both_since(until_ns), "robot and plant")
    told = [] if how == "holds the lock" else [f"the router process {cause}; restarting"]
    assert stage.told == told
    assert stage.witness.status.vehicle == Vehicle.FAILSAFE


def a_robot_that_was_stopped_comes_back_stopped(
    stage: Stage, how: str, cause: str, sabotage: Sabotage
) -> None:
    with operating(stage.stack) as operator:
        assert operator.perform(StopNow()).ok
    stage.until(lambda: stage.said("emergency stop saved"), "the stop on the disk")
    stage.hurt("robot r1", how, sabotage)
    stage.until(lambda: stage.said_why("robot r1", cause, how), "the cause")
    stage.until(lambda: stage.said("emergency stop of the previous run still holds"), "the stop")
    stage.until(lambda: stage.witness.status.vehicle == Vehicle.EMERGENCY_STOP, "stopped")
    with operating(stage.stack) as operator:
        refused = operator.perform(Arm())
        assert isinstance(refused, Refused)
        assert refused.reason == Reason.EMERGENCY_STOPPED
        assert operator.perform(ClearEmergencyStop()).ok
    stage.until(lambda: stage.witness.status.vehicle == Vehicle.STANDBY, "STANDBY")


@pytest.mark.parametrize("clock_name", CLOCKS)
def test_hub_robot_restarts_and_its_exception_is_reported(
    clock_name: str, sabotage: Sabotage
) -> None:
    with stage_of(router=False, clock_name=clock_name) as stage:
        sabotage.fail("robot")
        words = "ended by a core exception (ZeroDivisionError: as the test wants it"
        stage.until(lambda: stage.said("restarted: the previous run", words[:40]), "the cause")
        assert words in stage.told[0]
        stage.until(lambda: stage.witness.status.vehicle == Vehicle.STANDBY, "STANDBY")


def test_up_ends_when_a_process_keeps_dying(sabotage: Sabotage) -> None:
    with stage_of(router=False, policy=RestartPolicy(limit=1)) as stage:
        stage.hurt("robot r1", "SIGKILL", sabotage)
        stage.until(lambda: stage.said("restarted"), "it is back")
        stage.hurt("robot r1", "SIGKILL", sabotage)
        with pytest.raises(ChildExitError, match=r"GIVEN UP: .* 2 times within 60 s"):
            stage.until(lambda: False, "giving up")


def test_hanging_robot_ends_itself_and_the_next_reports_it(
    tmp_path: Path, sabotage: Sabotage
) -> None:
    """Run without a supervisor, as in a container."""
    state = ("--state", str(tmp_path / "state"))
    with Crew() as crew:
        robot = crew.robot(*state)
        watch = crew.dialling("watch")
        watch.says("BOOT")
        sabotage.hang("robot")
        assert robot.ends() == -signal.SIGALRM
        assert "Traceback" not in robot.said
        assert "thread" not in robot.said
        again = crew.robot(*state)
        words = "restarted: the previous run hung (its loop did not run for 5 s)"
        assert words in again.said
        watch.says(f"r1: {words}")
        assert "most recent call" in (tmp_path / "state" / "hung-before.txt").read_text()
        again.send(signal.SIGKILL)
        again.ends()
        third = crew.robot(*state)
        assert "restarted: the previous run ended without a report" in third.said
        third.send(signal.SIGTERM)
        assert third.ends() == 0
        assert "again" not in crew.robot(*state).said


AT_ONCE_S = 2.0
ENDED_BY = {"watch", "ground", "goto"}  # they have not done what they were asked to
OWN_TERMINAL = f"""
import fcntl, os, sys
fcntl.ioctl(0, {termios.TIOCSCTTY}, 0)
os.execv(sys.argv[1], sys.argv[1:])
"""


@contextmanager
def everybody(folder: Path) -> Iterator[tuple[dict[str, Running], Witness]]:
    """Start every kind of process and a driving robot; yield them in the order of their end."""
    with Crew() as crew, Crew(router=True) as other:
        plant, robot = crew.plant(waits=False), crew.robot()
        with Witness(crew.endpoint) as witness:
            witness.ready()
            found = {
                "watch": crew.dialling("watch"),
                "ground": crew.dialling("ground"),
                "record": crew.dialling("record", str(folder)),
                "goto": departs(crew, witness, "goto", "5.4", "2"),
            }
            until(lambda: written(folder) > 2000, what="a log")
            found["watch"].says("r1")
            found["ground"].says("r1")
            yield {**found, "plant": plant, "robot": robot, "router": other.router}, witness


def written(folder: Path) -> int:
    return sum(log.stat().st_size for log in folder.glob("*.tlog"))


def ends_well(name: str, running: Running, number: signal.Signals, within_s: float) -> None:
    assert running.ends(within_s) == (128 + number if name in ENDED_BY else 0), running.said
    assert "Traceback" not in running.said


@pytest.mark.parametrize(
    ("number", "within_s"),
    [
        pytest.param(signal.SIGINT, AT_ONCE_S, marks=pytest.mark.realtime),
        (signal.SIGTERM, PATIENCE_S),
    ],
)
def test_each_process_ends_in_time(tmp_path: Path, number: signal.Signals, within_s: float) -> None:
    with everybody(tmp_path) as (processes, _):
        for name, running in processes.items():
            running.send(number)
            ends_well(name, running, number, within_s)
    assert frames_in(tmp_path) > 20


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_signals_sent_while_a_verb_ends_change_nothing(number: signal.Signals) -> None:
    with Crew() as crew:
        crew.plant(waits=False)
        crew.robot()
        watching = crew.dialling("watch")
        watching.says("r1")
        for _ in range(2000):
            watching.send(number)
            with suppress(subprocess.TimeoutExpired):
                watching.process.wait(0.001)
        assert watching.ends() == 128 + number
        assert watching.said.count("sidestep watch: interrupted") == 1
        assert "Traceback" not in watching.said


@pytest.mark.parametrize(
    ("number", "within_s"),
    [
        (signal.SIGKILL, PATIENCE_S),
        pytest.param(signal.SIGSTOP, AT_ONCE_S, marks=pytest.mark.realtime),
    ],
)
def test_they_end_although_their_hub_is_gone_or_hangs(
    tmp_path: Path, number: signal.Signals, within_s: float
) -> None:
    with everybody(tmp_path) as (processes, witness):
        processes.pop("robot").send(number)
        until(witness.bus.lost, what="the link to be given up")
        for running in processes.values():
            running.send(signal.SIGINT)
        for name, running in processes.items():
            ends_well(name, running, signal.SIGINT, within_s)
    assert frames_in(tmp_path) > 20


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("role", ["plant", "robot"])
def test_process_that_still_connects_ends_too(role: str, number: signal.Signals) -> None:
    with Crew() as crew:
        dialling = crew.dialling(role)
        until(lambda: opening(dialling), what="dialling")
        dialling.send(number)
        assert dialling.ends() in (130, -signal.SIGTERM)
        assert "Traceback" not in dialling.said


def opening(running: Running) -> bool:
    """Zenoh's threads are there, so it is being opened."""
    return len(list(Path(f"/proc/{running.process.pid}/task").iterdir())) > 2


@pytest.mark.parametrize("children", [1, 2, 3])
def test_up_ends_at_any_moment_of_its_start(tmp_path: Path, children: int) -> None:
    with Crew() as crew:
        up = crew.start("up", "--json", "--record", str(tmp_path))
        until(lambda: len(children_of(up.process.pid)) >= children, what="children")
        started = children_of(up.process.pid)
        up.send(signal.SIGINT)
        assert up.ends() == 130
        assert not [pid for pid in started if alive(pid)]
        assert "Traceback" not in up.said


def test_ctrl_c_in_a_terminal_ends_up_and_all_it_started(tmp_path: Path) -> None:
    """The terminal sends SIGINT to the whole process group."""
    ours, theirs = pty.openpty()
    words = command(["up", "--headless", "--record", str(tmp_path)], os.getpid())
    with Crew() as crew, os.fdopen(ours, "wb", buffering=0) as keyboard:
        up = crew.execute(sys.executable, "-c", OWN_TERMINAL, *words, terminal=theirs)
        os.close(theirs)
        fcntl.fcntl(ours, fcntl.F_SETFL, os.O_NONBLOCK)
        screen = bytearray()
        until(lambda: b" m/s" in read(ours, screen), what="the live line")
        until(lambda: written(tmp_path) > 2000, what="a log")
        started = children_of(up.process.pid)
        keyboard.write(b"\x03")
        assert up.ends() == 130
        assert b"interrupted" in read(ours, screen)
        assert b"Traceback" not in screen
    assert len(started) == 3
    assert not [pid for pid in started if alive(pid)]
    assert frames_in(tmp_path) > 20


def read(terminal: int, screen: bytearray) -> bytearray:
    with suppress(BlockingIOError, OSError):  # nothing new, or the other end is closed
        screen += os.read(terminal, 1 << 16)
    return screen


TOUR = """
[[waypoint]]
x_m = 1.2
y_m = 2.0

[fence]
circle = { x_m = 1.0, y_m = 2.0, radius_m = 1.5 }
"""


def test_a_robot_that_was_killed_has_its_fence_and_its_mission_again(tmp_path: Path) -> None:
    tour, state = tmp_path / "tour.toml", tmp_path / "state"
    tour.write_text(TOUR)
    with Crew() as crew:
        robot = crew.robot("--state", str(state))
        assert crew.run("mission", "upload", str(tour))[0] == 0
        robot.send(signal.SIGKILL)
        robot.ends()
        robot = crew.robot("--state", str(state))
        robot.says("robot r1: fence restored")
        robot.says("robot r1: mission restored, 1 item, not started")
        code, said = crew.run("fence", "show")
        assert (code, said.strip()) == (0, "circle of 1.5 m around (1, 2)")
        code, said = crew.run("mission", "status")
        assert (code, said.strip()) == (0, "ready, item 1 of 1")
        assert crew.run("fence", "off")[0] == 0
    with Crew() as crew:
        robot = crew.robot("--state", str(state))
        robot.says("mission restored")
        assert "fence" not in robot.said


def test_stop_outlives_a_kill_a_hang_and_a_power_cut() -> None:
    """`bench restarts --stops 50` is the long form."""
    assert [figure.name for figure in kept_stops(1) if figure.met is False] == []


SUSPENDED_S, RUNNING_S = 0.4, 0.05
"""After each suspension, the plant makes up for a few ticks only."""
TRIAL = ("--world", "u_trap", "--timeout", "3", "--json")


def robot_of(up: Running) -> int | None:
    with suppress(FileNotFoundError, ProcessLookupError):
        found = [pid for pid in children_of(up.process.pid) if " robot --" in cmdline(pid)]
        return found[0] if found else None
    return None


@contextmanager
def slowed(pid: int) -> Iterator[None]:
    """Suspend a process again and again, as a busy computer does."""
    over = Event()

    def suspend_and_resume() -> None:
        with suppress(ProcessLookupError):
            while not over.wait(RUNNING_S):
                os.kill(pid, signal.SIGSTOP)
                over.wait(SUSPENDED_S)
                os.kill(pid, signal.SIGCONT)

    thread = Thread(target=suspend_and_resume)
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join()


def result_of(running: Running, within_s: float) -> dict[str, object]:
    running.ends(within_s)
    found: dict[str, object] = json.loads(running.said.splitlines()[-1])
    return found


def test_slow_robot_slows_the_simulation_and_changes_nothing() -> None:
    with Crew() as crew:
        up = crew.start("up", "--headless", *TRIAL)
        until(lambda: robot_of(up), what="the robot")
        robot = robot_of(up)
        assert robot is not None
        up.says("u_trap: to")
        with slowed(robot):
            slow = result_of(up, 120.0)
        alone, said = result_of(crew.start("trial", *TRIAL), 120.0), up.said
    assert slow["outcome"] == alone["outcome"] == "timeout", said
    assert slow["digest"] == alone["digest"]
    assert float(str(slow["wall_s"])) > 3.5
    assert "x, computer busy" in said


def test_stop_does_not_wait_for_simulated_time() -> None:
    """Suspend the plant: no tick comes, and the stop is acknowledged between two ticks."""
    with Crew(lockstep=True) as crew:
        robot, plant = crew.robot(), crew.plant()
        with Witness(crew.endpoint) as witness:
            witness.ready()
            crew.dialling("goto", "5.4", "2")
            witness.driving()
            plant.send(signal.SIGSTOP)
            stopped = crew.dialling("estop", "--json")
            assert stopped.ends() == 0, stopped.said
            plant.send(signal.SIGCONT)
            until(lambda: witness.status.vehicle == Vehicle.EMERGENCY_STOP, what="E-STOP")
            until(witness.standing, what="standing")
        assert robot.process.poll() is None
