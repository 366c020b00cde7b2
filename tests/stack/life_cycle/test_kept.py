"""A robot that is killed and started again, for real: its fence is up, its mission waits."""

import signal
from pathlib import Path

import pytest

from checks.faults.restarts import kept_stops
from tests.support.stack.processes import Crew

pytestmark = pytest.mark.stack

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
