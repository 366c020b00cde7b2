"""Every navigator for any inputs: invariants, mirrored scenes, and bounded memory."""

from collections.abc import Sequence
from math import atan2, cos, hypot, inf, isfinite, nan, pi, sin
from random import Random
from unittest.mock import patch

import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, rule

from checks.speed.board.scenarios import (
    CarriedBody,
    EnclosedBody,
    ScenarioBody,
    lengths,
    state_bytes,
)
from protocol.navigators import NAVIGATORS as TRIAL_NAVIGATORS
from robot.core import states
from robot.core.motion import HALT
from robot.core.navigators import pace, vgm_and_bug
from robot.core.navigators.pace import DITHER_RAD, WEAVE_RAD
from robot.core.navigators.registry import NAVIGATORS, Navigator, new_memory
from robot.core.navigators.registry import NAVIGATORS as REGISTERED
from robot.core.parameters import DEFAULTS
from robot.core.perception import sonar_ring as rings
from robot.core.perception.sonar_ring import FRONT
from robot.core.ring import BEARINGS, SONARS
from robot.core.values import Decision, Goal, Outputs, Pose, wrap
from runtime.units import PERIOD_MS
from study.report.targets import STATE_BYTES
from tests.support.cores import (
    ALL,
    Driver,
    Tick,
    anything,
    goals,
    mirrored,
    mirrored_goal,
    reversed_bits,
    seen,
    sound,
)
from tests.support.each import each

LIMIT_MRAD_S = DEFAULTS.wheel_max_m_s / DEFAULTS.wheel_radius_m * 1000.0
numbers = st.sampled_from(sorted(NAVIGATORS))
BENDS = (DITHER_RAD, WEAVE_RAD)
"""Rotations of vgm_memory on a free way."""

every = pytest.mark.parametrize("navigator", sorted(NAVIGATORS))
floats = st.floats()  # NaN and infinity included


def check_bounds(outputs: Outputs) -> None:
    """Check that wheel speeds are whole and within limits, and that the twist is finite."""
    for mrad_s in (outputs.left_mrad_s, outputs.right_mrad_s):
        assert isinstance(mrad_s, int)
        assert abs(mrad_s) <= LIMIT_MRAD_S
    assert all(map(isfinite, outputs.twist)) or outputs.left_mrad_s == outputs.right_mrad_s == 0


def check_room(driver: Driver, outputs: Outputs) -> None:
    """Check that there is no forward speed with an echo ahead below the minimum distance."""
    ranges_m = [driver.state.ring.range_m[i] for i in FRONT]
    if any(range_m is not None and range_m <= DEFAULTS.guard_stop_m for range_m in ranges_m):
        assert outputs.left_mrad_s + outputs.right_mrad_s <= 0


class Ticks(RuleBasedStateMachine):
    """Any sequence of valid and invalid ticks, for any navigator, with repeated goals."""

    @initialize(navigator=numbers, goal=goals, side=st.sampled_from([states.LEFT, states.RIGHT]))
    def begin(self, navigator: int, goal: Goal, side: int) -> None:
        self.driver = Driver(navigator, goal, side)
        self.outputs = self.driver.tick(Tick((0, 0), (500,) * SONARS, ALL, ALL, 0))

    @rule(tick=anything)
    def broken(self, tick: Tick) -> None:
        self.outputs = self.driver.tick(tick)
        if tick.rolled is None or tick.range_mm is None:
            assert self.outputs.left_mrad_s == self.outputs.right_mrad_s == 0

    @rule(tick=sound, times=st.integers(1, 12))
    def whole(self, tick: Tick, times: int) -> None:
        for _ in range(times):
            self.outputs = self.driver.tick(tick)

    @rule(goal=goals)
    def somewhere_else(self, goal: Goal) -> None:
        self.driver.goal = goal

    @invariant()
    def bounds(self) -> None:
        if hasattr(self, "outputs"):
            check_bounds(self.outputs)
            check_room(self.driver, self.outputs)


TestTicks = Ticks.TestCase
TestTicks.settings = settings(max_examples=40, stateful_step_count=30, deadline=None)


@every
@settings(max_examples=25, deadline=None)
@given(
    st.lists(st.tuples(floats, floats, floats), min_size=1, max_size=8),
    floats,
    floats,
    st.tuples(*[st.one_of(st.integers(0, 4000), st.just(nan))] * SONARS),
    st.integers(0, ALL),
)
def test_no_pose_goal_or_ring_breaks_a_navigator(
    navigator: int,
    poses: list[tuple[float, float, float]],
    x_m: float,
    y_m: float,
    range_mm: tuple[float, ...],
    echo: int,
) -> None:
    """Test the step alone, without the failsafes that would stop such numbers."""
    memory, ring = new_memory(navigator, states.LEFT), seen(range_mm, echo)
    goal = Goal(x_m, y_m, None, 0.05, 0.05)
    for pose in poses:
        decision = NAVIGATORS[navigator].step(memory, Pose(*pose), ring, goal, DEFAULTS)
        assert states.TO_GOAL <= decision.branch <= states.LOST


@settings(max_examples=30, deadline=None)
@given(
    st.lists(sound, min_size=5, max_size=30),
    st.floats(-pi, pi),
    st.sampled_from([states.TO_GOAL, states.PASS_LEFT, states.PASS_RIGHT]),
)
def test_faulty_navigator_cannot_drive_into_an_echo(
    story: list[Tick], turn_rad: float, branch: int
) -> None:
    with pytest.MonkeyPatch.context() as patch:
        mad = Navigator(
            NAVIGATORS[states.VGM].memory,
            lambda memory, pose, ring, goal, params: Decision(
                branch, None, inf, 0.0, turn_rad, 1e9, 1e9, inf
            ),
            True,
        )
        patch.setitem(NAVIGATORS, states.VGM, mad)
        driver = Driver(states.VGM, Goal(50.0, 0.0, None, 0.05, 0.05))
        for tick in story:
            outputs = driver.tick(tick._replace(range_mm=(25, *tick.range_mm[1:])))  # type: ignore[index]
            check_bounds(outputs)
            check_room(driver, outputs)
            near = tick._replace(range_mm=(3000, 3000, 39, *tick.range_mm[3:]), echo=ALL)  # type: ignore[index]
            outputs = driver.tick(near)
            assert outputs.left_mrad_s + outputs.right_mrad_s <= 0


@given(
    st.builds(Pose, st.floats(-20, 20), st.floats(-20, 20), st.floats(-pi, pi)),
    st.integers(0, SONARS - 1),
    st.integers(20, 299),
    st.floats(-pi, pi),
    st.floats(0.5, 20.0),
)
def test_virtual_goal_is_tangent_to_the_nearest_echo(
    pose: Pose, sonar: int, near_mm: int, goal_at_rad: float, distance_m: float
) -> None:
    range_mm = [3000] * SONARS
    range_mm[sonar] = near_mm
    x_m, y_m = pose.x_m + distance_m * cos(goal_at_rad), pose.y_m + distance_m * sin(goal_at_rad)
    memory = new_memory(states.VGM, states.LEFT)
    decision = vgm_and_bug.step_vgm(
        memory, pose, seen(range_mm), Goal(x_m, y_m, None, 0.05, 0.05), DEFAULTS
    )
    turn_rad = decision.goal_bearing_rad + decision.rotation_rad
    aside_rad = wrap(turn_rad - BEARINGS[sonar])
    assert abs(abs(aside_rad) - pi / 2) < 1e-9
    at_rad = atan2(decision.virtual_y_m - pose.y_m, decision.virtual_x_m - pose.x_m)
    assert abs(abs(wrap(at_rad - pose.heading_rad - BEARINGS[sonar])) - pi / 2) < 1e-9


@every
@given(
    st.lists(st.builds(Pose, st.floats(-9, 9), st.floats(-9, 9), st.floats(-pi, pi)), max_size=20),
    goals,
)
def test_without_obstacles_the_goal_is_not_rotated(
    navigator: int, poses: list[Pose], goal: Goal
) -> None:
    memory, ring = new_memory(navigator, states.LEFT), seen([0] * SONARS, echo=0)
    for pose in poses:
        decision = NAVIGATORS[navigator].step(memory, pose, ring, goal, DEFAULTS)
        assert decision.branch == states.TO_GOAL
        if navigator == states.VGM_MEMORY and decision.rotation_rad != 0.0:
            assert abs(decision.rotation_rad) in BENDS
            continue
        assert decision.rotation_rad == 0.0
        assert decision.virtual_x_m == pytest.approx(goal.x_m, abs=1e-9)
        assert decision.virtual_y_m == pytest.approx(goal.y_m, abs=1e-9)


@every
@settings(max_examples=15, deadline=None)
@given(st.lists(st.one_of(sound, anything), max_size=40), goals)
def test_the_same_inputs_give_the_same_outputs(
    navigator: int, story: list[Tick], goal: Goal
) -> None:
    one, other = Driver(navigator, goal), Driver(navigator, goal)
    for tick in story:
        assert repr(one.tick(tick)) == repr(other.tick(tick))  # repr: NaN equals itself
    assert one.ticks * PERIOD_MS == len(story) * PERIOD_MS


def check_mirror(one: Driver, other: Driver, tick: Tick) -> None:
    """Exclude two echoes at equal range, which have no mirror image."""
    assert tick.range_mm is not None
    assume(len(set(tick.range_mm)) == SONARS)
    ours, theirs = one.tick(tick), other.tick(mirrored(tick))
    assert abs(ours.left_mrad_s - theirs.right_mrad_s) <= 1
    assert abs(ours.right_mrad_s - theirs.left_mrad_s) <= 1
    assert ours.guard == theirs.guard


sides = pytest.mark.parametrize("side", [states.LEFT, states.RIGHT])


@pytest.mark.parametrize("navigator", [states.BUG, states.VGM])
@sides
@settings(max_examples=25, deadline=None)
@given(st.lists(sound, min_size=1, max_size=40), goals)
def test_mirrored_inputs_give_mirrored_outputs(
    side: int, navigator: int, story: list[Tick], goal: Goal
) -> None:
    """Mirror the preferred side too."""
    assume(abs(goal.y_m) > 1e-3)
    one, other = Driver(navigator, goal, side), Driver(navigator, mirrored_goal(goal), -side)
    for tick in story:
        check_mirror(one, other, tick)


@pytest.mark.parametrize("navigator", sorted(set(NAVIGATORS) - {states.VGM_MEMORY}))
@sides
@settings(max_examples=25, deadline=None)
@given(sound, st.integers(1, 6), goals)
def test_static_scene_is_mirrored_by_float_navigators(
    side: int, navigator: int, tick: Tick, times: int, goal: Goal
) -> None:
    """Keep the robot in place: the state of a memory after jumping echoes depends on their order.

    The navigator with integers has its own test, test_mirror.
    """
    assume(abs(goal.y_m) > 1e-3)
    one, other = Driver(navigator, goal, side), Driver(navigator, mirrored_goal(goal), -side)
    for _ in range(times):
        check_mirror(one, other, tick._replace(rolled=(0, 0)))


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


AWAY = Goal(9.0, 4.0, None, 0.05, 0.05)


def test_every_registered_navigator_has_a_name() -> None:
    assert set(TRIAL_NAVIGATORS.values()) == set(REGISTERED)


@each("name", TRIAL_NAVIGATORS)
def test_memory_of_a_navigator_is_within_its_limit(name: str) -> None:
    assert 0 < state_bytes(name) <= STATE_BYTES


@each("kind", [EnclosedBody, CarriedBody])
@each("name", TRIAL_NAVIGATORS)
def test_memory_never_grows(name: str, kind: type[ScenarioBody]) -> None:
    """Run 1000 ticks with one memory, whatever it decides, without a machine that would end it."""
    number, ring = TRIAL_NAVIGATORS[name], rings.Ring()
    memory, body = new_memory(number, states.LEFT), body_of(kind)
    before = lengths(memory)
    for tick in range(1000):
        rings.update(ring, body.scan(), 50 * tick, DEFAULTS)
        pose = Pose(body.x_m, body.y_m, wrap(body.heading_rad))
        decision = REGISTERED[number].step(memory, pose, ring, AWAY, DEFAULTS)
        turn_rad = wrap(decision.goal_bearing_rad + decision.rotation_rad)
        yaw = max(-900, min(900, int(3000 * turn_rad)))
        speed = 3000 if abs(turn_rad) < 0.5 and ring.front_m > 0.1 else 0
        body.drive(Outputs(speed - 3 * yaw, speed + 3 * yaw, 0, HALT, None))
        assert lengths(memory) == before


def body_of(kind: type[ScenarioBody]) -> ScenarioBody:
    assert kind in (EnclosedBody, CarriedBody)
    return (EnclosedBody if kind is EnclosedBody else CarriedBody)(DEFAULTS, Random(3), 3)
