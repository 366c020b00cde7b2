"""`up` restarts processes that exit or hang; the new one stays stopped and gives the cause."""

import os
import signal
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from functools import partial
from itertools import cycle, product
from pathlib import Path

import pytest

from checks.faults.restarts import NO_PAUSE, ArrivalTimes, running
from ground.cli.run.up import goal_runs_of
from ground.client.goal import destination
from ground.client.link import open_link
from ground.client.operations.commands import Arm, ClearEmergencyStop, StopNow
from ground.client.operations.goals import Goto
from ground.client.operations.place import SetTruePose
from ground.client.operations.session import Session
from ground.client.results import Refused
from ground.launch import child_command
from ground.launch.child_processes import ChildExitError
from ground.launch.fleet_run import FleetRun
from ground.launch.launcher import Stack
from ground.launch.restart_policy import RestartPolicy
from ground.launch.scenario import CLOCKS, WALL
from ground.text.output import Output
from protocol.wire.enums import GoalState, Vehicle
from protocol.wire.reasons import Reason
from runtime.clock import WallClock
from runtime.watchdog import HANGS
from tests.support.stack.process_table import children_of
from tests.support.stack.processes import Crew, Witness, moved_not, real_time
from tests.support.stack.spoilt import Sabotage
from tests.support.until import until

pytestmark = pytest.mark.stack

MS = 1_000_000
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

        until(there, HEALED_S, what, ROUND_S)

    def drive(self) -> None:
        """Armed, on its way; on a busy machine it may stop for its budget, and is sent again."""
        hears, witness = self.stack._bus, self.witness
        assert hears is not None
        says, clock = Output(as_json=False), WallClock()
        goal_runs = goal_runs_of(self.stack, hears, says, clock)
        fleet_run = FleetRun(goal_runs, clock, self.look, lambda _: None)
        for pid in children_of(os.getpid()):
            real_time(pid)
        deadline_s = time.monotonic() + DRIVES_S
        while time.monotonic() < deadline_s:
            fleet_run.launch(lockstep=False)
            stopped = len(witness.statuses)
            self.until(partial(self.under_way, stopped), "driving")
            if self.moves():
                return
        raise AssertionError(f"stopped by itself for {DRIVES_S:g} s")

    def set_true_place(self) -> None:
        """Require that the robot refuses a goal for its unknown place, and give it the true one."""
        self.until(lambda: self.said("PLACE UNKNOWN"), "the loss of the place")
        with open_link(self.stack.common) as link:
            session = Session(link)
            refused = Goto(goal=destination([1.0, 1.0]), wait=False).perform(session)
            assert isinstance(refused, Refused)
            assert refused.reason == Reason.PLACE_UNKNOWN
            assert SetTruePose().perform(session).ok

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
    assert all(moved_not(truth) for truth, _ in tuple(witness.truths)[seen:])
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
    with open_link(stage.stack.common) as link:
        assert StopNow().perform(Session(link)).ok
    stage.until(lambda: stage.said("emergency stop saved"), "the stop on the disk")
    stage.hurt("robot r1", how, sabotage)
    stage.until(lambda: stage.said_why("robot r1", cause, how), "the cause")
    stage.until(lambda: stage.said("emergency stop of the previous run still holds"), "the stop")
    stage.until(lambda: stage.witness.status.vehicle == Vehicle.EMERGENCY_STOP, "stopped")
    with open_link(stage.stack.common) as link:
        session = Session(link)
        refused = Arm().perform(session)
        assert isinstance(refused, Refused)
        assert refused.reason == Reason.EMERGENCY_STOPPED
        assert ClearEmergencyStop().perform(session).ok
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
