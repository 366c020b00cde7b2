"""A mirrored scene gives a mirrored choice, within the rounding to millimetres and brads."""

from collections.abc import Sequence
from math import cos, hypot, sin
from unittest.mock import patch

from hypothesis import assume, given, settings
from hypothesis import strategies as st

from robot.core import states
from robot.core.navigators import pace
from robot.core.navigators.registry import NAVIGATORS, new_memory
from robot.core.parameters import DEFAULTS
from robot.core.values import SONARS, Goal, Pose, wrap
from tests.support.robot.core.rings import seen
from tests.support.robot.core.stories import ALL, goals, mirrored_goal, reversed_bits

JOLTS = 16
LOOKS = 24
nearby = st.one_of(st.integers(20, 300), st.integers(20, 3000))
scenes = st.tuples(*[nearby] * SONARS)


def looked_at(
    pose: Pose, goal: Goal, range_mm: Sequence[int], echo: int, turn: int
) -> tuple[int, float, float]:
    """Return the choice of vgm_memory for a static scene, starting with this ping group."""
    memory, ring = new_memory(states.VGM_MEMORY, states.LEFT), seen(range_mm, echo)
    memory.phase = turn
    # The way weaves and bends to and fro; the first bend is always on the same side.
    straight = [patch.object(pace, name, return_value=0.0) for name in ("weave", "dither", "sweep")]
    with straight[0], straight[1], straight[2]:
        for _ in range(LOOKS):
            decision = NAVIGATORS[states.VGM_MEMORY].step(memory, pose, ring, goal, DEFAULTS)
    return decision.branch, decision.rotation_rad, decision.speed_limit_m_s


def is_like(
    one: tuple[int, float, float], other: tuple[int, float, float], off_rad: float, off_m_s: float
) -> bool:
    return (
        one[0] == other[0]
        and abs(wrap(one[1] - other[1])) <= off_rad
        and abs(one[2] - other[2]) <= off_m_s
    )


def is_on_the_verge(pose: Pose, goal: Goal, range_mm: Sequence[int], echo: int) -> bool:
    """Return whether a small change of the scene, or the first ping group, changes the choice."""
    here = looked_at(pose, goal, range_mm, echo, 0)
    for k in range(JOLTS):
        most_mm = 1 + k // 8 * 2
        jolted_mm = [
            max(20, range_mm[i] + (most_mm if (k * 37 + i * 11) % 16 < 8 else -most_mm))
            for i in range(SONARS)
        ]
        turned_rad = 0.003 if k & 1 else -0.003
        jolted = Pose(
            pose.x_m + 0.002 * cos(k), pose.y_m + 0.002 * sin(k), pose.heading_rad + turned_rad
        )
        if not is_like(here, looked_at(jolted, goal, jolted_mm, echo, k % 4), 0.03, 0.01):
            return True
    return False


@settings(max_examples=40, deadline=None, derandomize=True)
@given(
    st.builds(Pose, st.floats(-3, 3), st.floats(-3, 3), st.floats(-3, 3)),
    scenes,
    st.integers(0, ALL),
    goals,
)
def test_static_scene_is_mirrored_by_vgm_memory(
    pose: Pose, range_mm: tuple[int, ...], echo: int, goal: Goal
) -> None:
    """Integers round down on both sides of the axis.

    The even ping group is the mirror image of the odd one, and points lose weight in the order of
    their arrival. So the mirrored memory starts with the other group, the tolerance is that of the
    rounding, and scenes on the limit between two choices are excluded.
    """
    assume(hypot(goal.x_m - pose.x_m, goal.y_m - pose.y_m) > 0.1)
    assume(not is_on_the_verge(pose, goal, range_mm, echo))
    twin = Pose(pose.x_m, -pose.y_m, -pose.heading_rad)
    echo_twin = reversed_bits(echo)
    branch, rotation_rad, speed_m_s = looked_at(
        twin, mirrored_goal(goal), range_mm[::-1], echo_twin, 1
    )
    swapped = {states.PASS_LEFT: states.PASS_RIGHT, states.PASS_RIGHT: states.PASS_LEFT}
    theirs = swapped.get(branch, branch), -rotation_rad, speed_m_s
    assert is_like(looked_at(pose, goal, range_mm, echo, 0), theirs, 0.05, 0.02)
