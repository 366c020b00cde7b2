"""`docker compose up`: a robot that drives, with no more rights than it needs."""

import pytest

from tests.compose.compose import Compose

pytestmark = pytest.mark.compose

PARTS = ("router", "plant", "robot", "web")


def test_the_data_of_every_part_flow(stack: Compose) -> None:
    assert {part: stack.health(part) for part in PARTS} == dict.fromkeys(PARTS, "healthy")


def test_a_script_sends_the_robot_to_a_place(stack: Compose) -> None:
    done = stack.verb("goto", "1.2", "2.0", "--json")
    assert done.code == 0, done.said
    assert '"outcome": "reached"' in done.said
