"""A real robot on a slow disk: it drives on, and what it has acknowledged survives a kill.

Its control thread uses no file system while the loop runs: an audit hook would end the process.
"""

import os
import signal
import sys
from itertools import pairwise
from pathlib import Path

import pytest

from protocol.wire.enums import Vehicle
from runtime.units import NS_PER_S
from tests.support.stack.processes import (
    Crew,
    Running,
    Witness,
    departs,
)

pytestmark = pytest.mark.stack

ROOT = Path(__file__).parents[3]
FSYNC_S = 1.0
TOUCHED = "the control thread used the file system"
SLOW_DISK = f"""
import os, sys, threading, time
sys.path.insert(0, sys.argv.pop(1))
import sidestep
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
sys.exit(sidestep.main())
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
