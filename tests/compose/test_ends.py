"""Start and stop times of containers, their last log lines, and restarts."""

from time import monotonic
from typing import Final

import pytest

from protocol.wire.enums import Vehicle
from tests.support.compose.compose import Compose, project
from tests.support.until import until

pytestmark = pytest.mark.compose

PARTS: Final = ("router", "plant", "robot", "web")
WANTED_S: Final = 10.0
PATIENCE: Final = 12
"""How many times as long as on a machine that does nothing else may be taken."""

KILL_ALL: Final = ("sh", "-c", "kill -9 -1")
"""All processes of the container but the first, which then ends it."""


def first_drive_s(compose: Compose, began_s: float) -> float:
    """Return when the robot first drives; a busy machine may delay it."""
    said: list[str] = []
    while monotonic() - began_s < WANTED_S * PATIENCE:
        with compose.running("run", "--rm", "-T", "ground", "goto", "2.0", "2.0") as process:
            assert process.stdout is not None
            for line in process.stdout:
                said.append(line.decode())
                if said[-1].startswith("driving"):
                    return monotonic() - began_s
        compose.arms()
    raise AssertionError("".join(said))


def test_from_up_to_a_robot_that_drives(image: str, capsys: pytest.CaptureFixture[str]) -> None:
    with project(image) as compose:
        began_s = monotonic()
        compose.does("up", "-d", "--no-build")
        took_s = first_drive_s(compose, began_s)
    with capsys.disabled():
        print(f"\nfrom up to driving: {took_s:.1f} s (wanted: {WANTED_S:g} s)")
    assert took_s < WANTED_S * PATIENCE


def test_down_ends_all_containers_in_time(image: str) -> None:
    with project(image) as compose:
        compose.up()
        with compose.running("logs", "--follow") as following:
            began_s = monotonic()
            compose.does("stop")
            took_s = monotonic() - began_s
            said, _ = following.communicate(timeout=30)
        codes = {part: compose.inspected(part)["State"]["ExitCode"] for part in PARTS}
    assert codes == dict.fromkeys(PARTS, 0)
    for last in ("router ends", "plant: ends", "robot r1: ends", "ground station ends"):
        assert last in said.decode(), said.decode()
    assert took_s < 5.0


def test_killed_robot_restarts_disarmed_and_reports_why(stack: Compose) -> None:
    stack.arms()
    stack.inside("robot", *KILL_ALL)
    until(lambda: stack.logs("robot").count("ready, disarmed") == 2, 30.0, "a second robot")
    assert "restarted: the previous run" in stack.logs("robot")
    stack.becomes("healthy", "robot")
    seen = stack.verb("watch", "--json").object
    assert seen["streams"]["tlm/status"]["message"]["vehicle"] == Vehicle.STANDBY
    assert stack.inspected("robot")["RestartCount"] == 1


def test_a_router_that_was_killed_comes_back_and_all_find_each_other_again(stack: Compose) -> None:
    stack.inside("router", *KILL_ALL)
    until(lambda: stack.inspected("router")["RestartCount"] == 1, 30.0, "another router")
    until(lambda: stack.verb("doctor").code == 0, 60.0, "all find each other")
