"""Following: the room at each flank, and the change of the side."""

from math import inf

import pytest

from robot.core.navigators import vgm_following
from robot.core.navigators.vgm_following import (
    EASE_MM,
    FAR_M,
    LEFT_SONARS,
    MAX_LOOPS,
    RIGHT_SONARS,
    Memory,
)
from robot.core.values import SONARS
from tests.support.each import each
from tests.support.robot.core.rings import heard
from tests.support.robot.core.vgm_memory import SIDES


def test_room_is_summed_over_the_sonars_of_a_flank() -> None:
    seen = heard([0.1, 0.2, 0.3, 0.4, 1.0, 1.0, 1.0, 2.0])
    assert vgm_following.room_m(seen, RIGHT_SONARS) == pytest.approx(1.0)
    assert vgm_following.room_m(seen, LEFT_SONARS) == pytest.approx(5.0)
    assert sorted((*RIGHT_SONARS, *LEFT_SONARS)) == list(range(SONARS))


def test_free_range_counts_as_far_and_missing_one_as_none() -> None:
    seen = heard([inf, FAR_M + 1.0, None, 0.5, None, None, None, None])
    assert vgm_following.room_m(seen, RIGHT_SONARS) == pytest.approx(2.0 * FAR_M + 0.5)
    assert vgm_following.room_m(seen, LEFT_SONARS) == 0.0


@SIDES
def test_other_side_is_tried_with_smaller_margins(side: int) -> None:
    memory = Memory()
    memory.side, memory.following, memory.proof.is_valid = side, True, True
    memory.loops.count = 5
    vgm_following.try_other_side(memory, 1)
    assert (memory.side, memory.ease_mm) == (-side, EASE_MM)
    assert (memory.following, memory.awaits_proof, memory.lost) == (True, True, False)
    assert not memory.proof.is_valid
    assert memory.loops.count == 0


@each("weight", [1, 2])
def test_robot_is_lost_after_enough_loops_by_weight(weight: int) -> None:
    memory, tries = Memory(), 0
    while not memory.lost:
        vgm_following.try_other_side(memory, weight)
        tries += 1
        assert tries <= MAX_LOOPS
    assert tries * weight == MAX_LOOPS
    assert not memory.given_up
