"""A real robot on a slow disk: it drives on, and what it has acknowledged survives a kill.

Its control thread uses no file system while the loop runs: an audit hook would end the process.
"""

import os
import signal
import sys
from pathlib import Path

import pytest

from protocol.wire.enums import Vehicle
from tests.support.stack.processes import (
    Crew,
    Running,
    Witness,
    departs,
)
from tests.support.until import until

pytestmark = pytest.mark.stack

ROOT = Path(__file__).parents[3]
FSYNC_S = 0.5
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


def missed(witness: Witness) -> int:
    """Ticks that the robot has missed so far."""
    until(lambda: witness.report, what="a cycle report")
    assert witness.report is not None
    return witness.report.missed


def test_slow_disk_holds_up_answers_and_no_tick(tmp_path: Path) -> None:
    tour, state = tmp_path / "tour.toml", tmp_path / "state"
    tour.write_text(WHOLE_WORLD)
    with Crew() as crew:
        robot = slow_robot(crew, state)
        crew.plant()
        with Witness(crew.endpoint) as witness:
            witness.ready()
            assert departs(crew, witness, "goto", "5.4", "2", "--no-wait").ends() == 0
            before = missed(witness)
            code, said = crew.run("param", "set", "d_obs_m", "0.31")
            assert (code, "saved on the robot" in said) == (0, True), said
            code, said = crew.run("mission", "upload", str(tour))
            robot.send(signal.SIGKILL)
            assert code == 0, said
            assert missed(witness) - before < FSYNC_S / 0.05 - 3, "one fsync would miss more"
            assert witness.status.vehicle == Vehicle.ACTIVE, witness.texts
            assert TOUCHED not in robot.said
        robot.ends()
        robot = crew.robot("--state", str(state))
        robot.says("fence restored")
        robot.says("mission restored, 1 item")
        code, said = crew.run("param", "get", "d_obs_m")
        assert said.strip() == "d_obs_m = 0.31 m"
