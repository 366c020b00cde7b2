"""Liveliness tokens: only those of robots, roles and sessions that can be some are taken."""

import pytest

from protocol.bus.presence import Presence, presence_in
from tests.hostile import TEXT


def test_a_token_says_robot_role_and_session() -> None:
    assert presence_in("sidestep/r1/alive/robot/4f2a") == Presence("r1", "robot", "4f2a")
    assert presence_in("a/b/r-2/alive/ground/0") == Presence("r-2", "ground", "0")


@pytest.mark.parametrize(
    "key",
    [
        f"sidestep/r{TEXT}/alive/robot/4f2a",
        f"sidestep/r1/alive/{TEXT}/4f2a",
        f"sidestep/r1/alive/robot/{TEXT}",
        "sidestep/r1\n/alive/robot/4f2a",
        "sidestep/R1/alive/robot/4f2a",
        f"sidestep/{'r' * 17}/alive/robot/4f2a",
        "sidestep/r1/alive/nobody/4f2a",
        f"sidestep/r1/alive/robot/{'0' * 33}",
        "sidestep//alive/robot/4f2a",
    ],
)
def test_any_other_token_is_none(key: str) -> None:
    assert presence_in(key) is None
