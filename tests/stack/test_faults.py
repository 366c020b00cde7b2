"""Robots that fail, hang, are killed or have a slow disk; the fault matrix, and a short soak."""

import argparse
import json
import os
import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import pytest

from checks.endurance import soak
from checks.endurance import soak as soak_report
from checks.endurance.fleet import PLANT, SUPERVISOR
from checks.faults.cases import FAULTS
from checks.harness.crew import LATE as PROCESSES_LATE
from checks.harness.crew import Crew, Witness, departs
from checks.harness.observer import is_still
from checks.harness.processes import Running
from checks.harness.until import until
from protocol.wire.enums import GoalState, Vehicle
from protocol.wire.reasons import Reason, reason_text
from runtime.units import NS_PER_S

pytestmark = pytest.mark.stack

ROOT = Path(__file__).parents[2]
FAILS_ON_SIGNAL = """
import os, signal, sys
sys.path.insert(0, sys.argv.pop(1))
from sidestep.__main__ import main
from ground.launch.child_command import die_with_parent
from robot.core import brain
die_with_parent(int(sys.argv.pop(1)))
whole, signals = brain.step, []
signal.signal(signal.SIGUSR1, lambda number, _: signals.append(number))

def step(*given):
    if signals:
        raise ZeroDivisionError("as the test wants it")
    return whole(*given)

brain.step = step
sys.exit(main())
"""
HANGS_ON_SIGNAL = FAILS_ON_SIGNAL.replace(
    'raise ZeroDivisionError("as the test wants it")', "import time; time.sleep(600)"
).replace(
    "whole, signals",
    "from runtime.watchdog import Watchdog; Watchdog.reset = lambda self: None\nwhole, signals",
)
"""Its watchdog would end it after a few seconds, before a busy machine has started a doctor."""


def spoilt_robot(crew: Crew, script: str, *more: str) -> Running:
    """Start a robot, the hub, that does as its script says when it receives SIGUSR1."""
    words = ("run", "robot", "--start", "0.6", "2", "0", "--listen", crew.endpoint, *more)
    start = (sys.executable, "-P", "-c", script, str(ROOT), str(os.getpid()), *words)
    robot = crew.execute(*start)
    robot.says("ready")
    return robot


def test_core_exception_stops_the_wheels_and_is_reported() -> None:
    with Crew(lockstep=True) as crew:
        robot = spoilt_robot(crew, FAILS_ON_SIGNAL, "--lockstep")
        crew.plant()
        with Witness(crew.endpoint) as witness:
            witness.ready()
            goto = departs(crew, witness, "goto", "5.4", "2")
            robot.send(signal.SIGUSR1)
            assert robot.ends() == 1
            until(lambda: witness.status.vehicle_reason == Reason.CORE_EXCEPTION)
            assert witness.status.vehicle == Vehicle.FAILSAFE
            assert witness.status.goal == GoalState.ABORTED
            assert witness.status.goal_reason == Reason.CORE_EXCEPTION
            assert any("vehicle FAILSAFE" in text for text in witness.texts)
            assert witness.speeds == (0, 0)
        assert "ZeroDivisionError: as the test wants it" in robot.said
        assert goto.ends() == 1
        assert reason_text(Reason.CORE_EXCEPTION) in goto.said


def test_doctor_distinguishes_suspended_from_absent_robot() -> None:
    with Crew() as crew:
        crew.plant(waits=False)
        robot = crew.robot()
        with Witness(crew.endpoint) as witness:
            witness.ready()
        watch = crew.dialling("watch")
        watch.says("STANDBY")
        robot.send(signal.SIGSTOP)
        late, doctor = crew.dialling("watch"), crew.dialling("doctor")
        assert doctor.ends() == 1
        assert f"a process listens at {crew.endpoint} but does not answer" in doctor.said
        assert "hangs" in doctor.said
        assert "restart the process" in doctor.said
        watch.says("hangs")
        assert late.ends() == 1
        assert "hangs" in late.said


def test_hanging_loop_is_distinguished_from_a_dead_process() -> None:
    """Use wall time: in lockstep the thread that hangs is one of the bus, which loses its link."""
    with Crew() as crew:
        robot = spoilt_robot(crew, HANGS_ON_SIGNAL)
        crew.plant()
        with Witness(crew.endpoint) as witness:
            witness.ready()
            watch = crew.dialling("watch")
            departs(crew, witness, "goto", "5.4", "2")
            told = len(witness.statuses)
            robot.send(signal.SIGUSR1)
            until(witness.standing, what="standing")
            is_active = witness.status.vehicle == Vehicle.ACTIVE
            assert is_active or witness.was_late(told), f"stopped itself: {witness.texts}"
            code, said = crew.run("doctor")
            assert code == 1, said
            assert "hangs, its process is alive but sends no heartbeat" in said
            watch.says("hangs")


GOAL = ("5.4", "2")


@dataclass
class Stage:
    """A stack whose robot drives, and an observer."""

    crew: Crew
    robot: Running
    plant: Running
    goto: Running
    witness: Witness

    def in_failsafe(self) -> bool:
        return self.witness.status.vehicle == Vehicle.FAILSAFE

    def stays_still(self) -> None:
        """Require that every truth from now on shows a robot at rest."""
        seen = len(self.witness.truths)
        until(lambda: len(self.witness.truths) > seen + 10, what="half a second of truth")
        assert all(is_still(truth) for truth, _ in tuple(self.witness.truths)[seen:])


@contextmanager
def driving(*, router: bool = False, lockstep: bool) -> Iterator[Stage]:
    with ExitStack() as scope:
        crew = scope.enter_context(Crew(router=router, lockstep=lockstep))
        plant, robot = crew.plant(waits=False), crew.robot()
        witness = scope.enter_context(Witness(crew.endpoint))
        witness.ready()
        goto = departs(crew, witness, "goto", *GOAL)
        yield Stage(crew, robot, plant, goto, witness)


def test_suspended_robot_does_not_drive_on_after_sigcont() -> None:
    """Use a router, so that the truth arrives without the robot."""
    with driving(router=True, lockstep=False) as stage:
        stage.robot.send(signal.SIGSTOP)
        until(stage.witness.standing, what="standing")
        stage.robot.send(signal.SIGCONT)
        until(stage.in_failsafe, what="FAILSAFE")
        assert stage.witness.status.vehicle_reason in PROCESSES_LATE
        stage.stays_still()
        assert stage.witness.status.goal == GoalState.ABORTED
        assert stage.goto.ends() == 1


def test_robot_without_plant_names_what_it_lacks() -> None:
    with driving(lockstep=False) as stage:
        stage.plant.send(signal.SIGKILL)
        until(stage.in_failsafe, what="FAILSAFE")
        reason = stage.witness.status.vehicle_reason
        assert reason in PROCESSES_LATE
        assert stage.goto.ends() == 1
        code, said = stage.crew.run("doctor")
        assert code == 1
        assert f"failsafe: {reason_text(reason)}" in said
        assert "no plant is running" in said


def test_when_goto_is_killed_guided_stops_for_want_of_an_operator() -> None:
    with driving(lockstep=True) as stage:
        stage.goto.send(signal.SIGKILL)
        until(stage.in_failsafe, what="FAILSAFE")
        assert stage.witness.status.vehicle_reason == Reason.OPERATOR_LOST
        until(stage.witness.standing, what="standing")
        stage.stays_still()


def test_ctrl_c_in_goto_aborts_the_goal() -> None:
    with driving(lockstep=True) as stage:
        stage.goto.send(signal.SIGINT)
        assert stage.goto.ends() == 130
        assert "goal aborted" in stage.goto.said
        until(lambda: stage.witness.status.goal == GoalState.ABORTED, what="ABORTED")
        assert stage.witness.status.goal_reason == Reason.BY_OPERATOR
        until(stage.witness.standing, what="standing")


FSYNC_S = 1.0
TOUCHED = "the control thread used the file system"
SLOW_DISK = f"""
import os, sys, threading, time
sys.path.insert(0, sys.argv.pop(1))
from sidestep.__main__ import main
from ground.launch.child_command import die_with_parent
from robot.process import RobotProcess
die_with_parent(int(sys.argv.pop(1)))
fsync, run, looping = os.fsync, RobotProcess.run, []

def in_loop():
    return threading.get_ident() in looping

def slow(number):
    if in_loop():
        end("fsync")
    time.sleep({FSYNC_S})
    fsync(number)

def watched(self, grid):
    looping.append(threading.get_ident())
    try:
        run(self, grid)
    finally:
        looping.clear()

def audit(event, given):
    if looping and in_loop() and (event == "open" or event.startswith("os.")):
        end(f"{{event}} {{given}}")

def end(what):
    os.write(2, f"{TOUCHED}: {{what}}".encode())
    os._exit(9)

os.fsync, RobotProcess.run = slow, watched
sys.addaudithook(audit)
sys.exit(main())
"""
WHOLE_WORLD = """
[[waypoint]]
x_m = 5.0
y_m = 2.0

[fence]
circle = { x_m = 2.0, y_m = 2.0, radius_m = 9.0 }
"""


def slow_robot(crew: Crew, state: Path) -> Running:
    place = ("--start", "0.6", "2", "0", "--listen", crew.endpoint, "--state", str(state))
    script = (sys.executable, "-P", "-c", SLOW_DISK, str(ROOT), str(os.getpid()))
    robot = crew.execute(*script, "run", "robot", *place)
    robot.says("ready")
    return robot


def longest_gap_s(witness: Witness, since: int) -> float:
    """Return the longest time from a status to the next one, by the robot's own account."""
    times_ns = [status.time_ns for status, _ in tuple(witness.statuses)[since:]]
    return max(later - earlier for earlier, later in pairwise(times_ns)) / NS_PER_S


def test_slow_disk_holds_up_answers_and_no_tick(tmp_path: Path) -> None:
    tour, state = tmp_path / "tour.toml", tmp_path / "state"
    tour.write_text(WHOLE_WORLD)
    with Crew() as crew:
        robot = slow_robot(crew, state)
        crew.plant()
        with Witness(crew.endpoint) as witness:
            witness.ready()
            assert departs(crew, witness, "goto", "5.4", "2", "--no-wait").ends() == 0
            before = len(witness.statuses)
            code, said = crew.run("param", "set", "d_obs_m", "0.31")
            assert (code, "saved on the robot" in said) == (0, True), said
            code, said = crew.run("mission", "upload", str(tour))
            robot.send(signal.SIGKILL)
            assert code == 0, said
            assert longest_gap_s(witness, before) < FSYNC_S, "a cycle waited for the disk"
            assert witness.status.vehicle == Vehicle.ACTIVE or witness.was_late(before)
            assert TOUCHED not in robot.said
        robot.ends()
        robot = crew.robot("--state", str(state))
        robot.says("fence restored")
        robot.says("mission restored, 1 item")
        code, said = crew.run("param", "get", "d_obs_m")
        assert said.strip() == "d_obs_m = 0.31 m"


QUICK = ("robot killed", "robot stopped", "plant killed", "robot | router")
"""These rows use real processes, too: each takes some seconds."""
LATE = re.compile(r", wall: ((known|stopped) after \d+ ms|reported BUDGET)")
"""In wall time a busy machine may be late, and a robot that notices stops for that; how late is in
docs/evidence/faults.md."""


def bench(*words: str, within_s: float = 240.0) -> tuple[int, str, str]:
    line = [sys.executable, "-m", "checks", "faults", *words]
    done = subprocess.run(line, capture_output=True, text=True, timeout=within_s, check=False)
    return done.returncode, done.stdout, done.stderr


def test_each_row_is_as_it_must_be(tmp_path: Path) -> None:
    words = ("--short", "--wall", "0", "--json", "--page", str(tmp_path / "faults.md"))
    code, said, told = bench(*words)
    assert json.loads(said)["notes"] == [], told
    assert code == 0
    page = (tmp_path / "faults.md").read_text()
    rows = [line for line in page.splitlines() if line.startswith("| ") and "must" not in line[:20]]
    assert len(rows) == len(FAULTS)
    assert not (tmp_path / "faults.jsonl").exists()


@pytest.mark.realtime
def test_real_processes_react_as_they_must() -> None:
    code, said, told = bench(
        "--short", "--lockstep", "0", "--json", "--jobs", "4", "--only", *QUICK
    )
    notes = json.loads(said)["notes"]
    assert told.count("wall ") == len(QUICK), told
    assert [note for note in notes if not LATE.search(note)] == [], told
    assert code == (0 if not notes else 1)


def test_what_is_kept_is_not_measured_again(tmp_path: Path) -> None:
    kept = tmp_path / "kept.jsonl"
    words = ("--only", "emergency stop", "--lockstep", "2", "--wall", "0", "--keep", str(kept))
    for measured in (2, 0):
        code, said, told = bench(*words)
        assert code == 0, said
        assert told.count("as required") == measured
    assert len(kept.read_text().splitlines()) == 2


def test_a_fault_that_there_is_not_is_refused_with_those_there_are() -> None:
    code, _, told = bench("--only", "earthquake")
    assert code != 0
    assert "no fault is named earthquake" in told
    assert "robot killed" in told


PATIENCE_S = 60.0


def test_it_heals_after_each_fault_and_the_log_lacks_no_event(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The fleet may heal slowly, as the machine may be busy."""
    monkeypatch.setattr(soak, "HEALED_S", PATIENCE_S)
    monkeypatch.setattr(soak, "READY_NS", PATIENCE_S * NS_PER_S)
    monkeypatch.setattr(soak_report, "HEALED_S", PATIENCE_S)
    parser = argparse.ArgumentParser()
    soak.add_options(parser)
    report = soak.measure(parser.parse_args(["--minutes", "0.25"]))
    found = {figure.name: figure.median for figure in report.figures}
    assert report.met, report.text()
    assert found["faults after which a robot stayed silent"] == 0
    assert found["events of r1 in the log"] > 10
    assert found["events of r1 that the log lacks"] == 0
    assert found["processes given up"] == 0
    happened, *rest = report.notes
    assert "robot r1 cut off for 4 s" in happened
    roles = {line.split(":")[0] for line in rest}
    assert roles >= {"router", "robot r1", "robot r2", "robot r3", "plant", "recorder r1"}
    assert {"ground r1", "ground r2", SUPERVISOR, PLANT} <= roles
