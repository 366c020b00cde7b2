"""The fence: what is inside, what is invalid, its effect, and one that could not be read."""

from collections.abc import Callable
from math import atan2, cos, hypot, inf, nan, pi, remainder, sin

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from robot.core import modes, reasons, states
from robot.core.modes import Machine
from robot.core.safety import failsafe
from robot.core.safety import fence as fences
from robot.core.safety.fence import Fence
from robot.core.values import Goal, Pose
from tests.support.cores import AHEAD, Driven, armed, driving
from tests.support.each import each

Places = list[tuple[float, float]]

SQUARE = Fence((0.0, 4.0, 4.0, 0.0), (0.0, 0.0, 4.0, 4.0), 0.0)
ELL = Fence((0.0, 4.0, 4.0, 2.0, 2.0, 0.0), (0.0, 0.0, 2.0, 2.0, 4.0, 4.0), 0.0)
ROUND = Fence((1.0,), (1.0,), 2.0)
AROUND = Fence((-1.0, 2.0, 2.0, -1.0), (-1.0, -1.0, 1.0, 1.0), 0.0)
WIDE = Fence((0.0,), (0.0,), 50.0)

coordinates = st.floats(-20.0, 20.0)
anything = st.floats(allow_nan=True, allow_infinity=True)


@st.composite
def stars(draw: st.DrawFn) -> Fence:
    """Return a star-shaped polygon: its corners in order of their bearing from the middle."""
    corners = draw(st.integers(3, 16))
    middle_x_m, middle_y_m = draw(coordinates), draw(coordinates)
    far_m = [draw(st.floats(0.5, 9.0)) for _ in range(corners)]
    turn = draw(st.floats(0.0, 2.0 * pi))
    bearings = [turn + 2.0 * pi * k / corners for k in range(corners)]
    return Fence(
        tuple(middle_x_m + far * cos(b) for far, b in zip(far_m, bearings, strict=True)),
        tuple(middle_y_m + far * sin(b) for far, b in zip(far_m, bearings, strict=True)),
        0.0,
    )


def off_m(fence: Fence, x_m: float, y_m: float) -> float:
    """Return the distance of a point from the border of a polygon."""
    nearest_m = inf
    for k in range(len(fence.xs_m)):
        ax, ay, bx, by = fence.xs_m[k - 1], fence.ys_m[k - 1], fence.xs_m[k], fence.ys_m[k]
        length_m = hypot(bx - ax, by - ay)
        along = ((x_m - ax) * (bx - ax) + (y_m - ay) * (by - ay)) / length_m**2
        share = max(0.0, min(1.0, along))
        nearest_m = min(
            nearest_m, hypot(ax + share * (bx - ax) - x_m, ay + share * (by - ay) - y_m)
        )
    return nearest_m


def turns(fence: Fence, x_m: float, y_m: float) -> int:
    """Return the winding number of a polygon around a point, by adding bearings."""
    total_rad = 0.0
    for k in range(len(fence.xs_m)):
        before_rad = atan2(fence.ys_m[k - 1] - y_m, fence.xs_m[k - 1] - x_m)
        after_rad = atan2(fence.ys_m[k] - y_m, fence.xs_m[k] - x_m)
        total_rad += remainder(after_rad - before_rad, 2.0 * pi)
    return round(total_rad / (2.0 * pi))


@each("fence", [SQUARE, ELL, ROUND, AROUND])
def test_valid_fence_is_accepted(fence: Fence) -> None:
    assert fences.refusal_of(fence) == reasons.OK


@each(
    ("x_m", "y_m", "within"),
    [
        (1.0, 1.0, True),
        (1.0, 3.9, True),
        (3.0, 3.0, False),
        (2.0, 3.0, True),
        (2.0, 2.0, True),
        (0.0, 0.0, True),
        (4.0, 2.0, True),
        (4.1, 2.0, False),
        (-0.1, 4.0, False),
        (-5.0, 0.0, False),
    ],
)
def test_l_shape_contains_its_inside_border_and_corners(
    x_m: float, y_m: float, within: bool
) -> None:
    assert fences.inside(ELL, x_m, y_m) is within


def test_a_circle_holds_its_rim() -> None:
    assert fences.inside(ROUND, 3.0, 1.0)
    assert not fences.inside(ROUND, 3.0, 1.001)


@given(stars(), coordinates, coordinates)
def test_inside_is_where_the_line_goes_once_around(fence: Fence, x_m: float, y_m: float) -> None:
    assume(off_m(fence, x_m, y_m) > 1e-6)
    assert fences.inside(fence, x_m, y_m) is (turns(fence, x_m, y_m) != 0)


@given(stars(), coordinates, coordinates)
def test_a_mirrored_or_reversed_fence_holds_the_mirrored_place(
    fence: Fence, x_m: float, y_m: float
) -> None:
    assume(off_m(fence, x_m, y_m) > 1e-6)
    within = fences.inside(fence, x_m, y_m)
    flipped = Fence(fence.xs_m, tuple(-y for y in fence.ys_m), 0.0)
    turned = Fence(tuple(-x for x in fence.xs_m), tuple(-y for y in fence.ys_m), 0.0)
    backwards = Fence(fence.xs_m[::-1], fence.ys_m[::-1], 0.0)
    assert fences.inside(flipped, x_m, -y_m) is within
    assert fences.inside(turned, -x_m, -y_m) is within
    assert fences.inside(backwards, x_m, y_m) is within


@given(stars())
def test_a_star_is_simple_and_so_is_its_mirror_image(fence: Fence) -> None:
    assert fences.refusal_of(fence) == reasons.OK
    assert fences.refusal_of(Fence(fence.ys_m, fence.xs_m, 0.0)) == reasons.OK


@given(stars(), st.data())
def test_a_fence_whose_sides_cross_is_refused(fence: Fence, data: st.DataObject) -> None:
    """Swap two adjacent corners of a convex polygon with four or more."""
    corners = len(fence.xs_m)
    assume(corners >= 4)
    k = data.draw(st.integers(0, corners - 2))
    xs_m = [cos(2.0 * pi * i / corners) for i in range(corners)]
    ys_m = [sin(2.0 * pi * i / corners) for i in range(corners)]
    for values in (xs_m, ys_m):
        values[k], values[k + 1] = values[k + 1], values[k]
    assert fences.refusal_of(Fence(tuple(xs_m), tuple(ys_m), 0.0)) == reasons.FENCE_NOT_SIMPLE


def polygon(places: Places) -> Fence:
    return Fence(tuple(x for x, _ in places), tuple(y for _, y in places), 0.0)


@each(
    "places",
    [
        [],
        [(0.0, 0.0)],
        [(0.0, 0.0), (1.0, 0.0)],
        [(0.0, 0.0), (1.0, 0.0), (2.0, 0.0)],  # encloses nothing
        [(0.0, 0.0), (2.0, 0.0), (2.0, 0.0), (0.0, 2.0)],  # a side without length
        [(0.0, 0.0), (4.0, 0.0), (4.0, 4.0), (2.0, 0.0)],  # a corner on another side
        [(0.0, 0.0), (4.0, 0.0), (1.0, 0.0), (0.0, 2.0)],  # folds back over itself
        [(0.0, 0.0), (4.0, 4.0), (4.0, 0.0), (0.0, 4.0)],  # crosses itself
        [(0.0, 0.0), (2.0, 2.0), (4.0, 0.0), (4.0, 4.0), (2.0, 2.0), (0.0, 4.0)],  # meets itself
        [(cos(k), sin(k)) for k in range(17)],
        [(0.0, 0.0), (nan, 0.0), (1.0, 1.0)],
        [(0.0, 0.0), (1.0, inf), (1.0, 1.0)],
        [(0.0, 0.0), (1e6, 0.0), (1.0, 1.0)],
    ],
)
def test_polygon_that_is_not_simple_is_refused(places: Places) -> None:
    assert fences.refusal_of(polygon(places)) == reasons.FENCE_NOT_SIMPLE


@each("radius_m", [nan, inf, -1.0, 0.05, 1e6])
def test_a_circle_needs_a_radius(radius_m: float) -> None:
    assert fences.refusal_of(Fence((0.0,), (0.0,), radius_m)) == reasons.FENCE_NOT_SIMPLE


def test_a_circle_has_one_middle() -> None:
    assert fences.refusal_of(Fence((), (), 1.0)) == reasons.FENCE_NOT_SIMPLE
    assert fences.refusal_of(Fence((0.0, 1.0), (0.0, 1.0), 1.0)) == reasons.FENCE_NOT_SIMPLE


@given(st.lists(st.tuples(anything, anything), max_size=18), anything, anything, anything)
def test_any_fence_and_place_raise_no_exception(
    places: Places, radius_m: float, x_m: float, y_m: float
) -> None:
    fence = polygon(places)
    assert fences.refusal_of(Fence(fence.xs_m, fence.ys_m, radius_m)) in (
        reasons.OK,
        reasons.FENCE_NOT_SIMPLE,
    )
    if fences.refusal_of(fence) == reasons.OK:
        assert fences.inside(fence, x_m, y_m) in (True, False)
        assert not fences.inside(fence, nan, y_m)
        assert not fences.inside(fence, x_m, -inf)


def test_only_goals_outside_the_fence_are_refused() -> None:
    driven = armed()
    assert modes.set_fence(driven.machine, AROUND, Pose(0.0, 0.0, 0.0)) == reasons.OK
    assert driven.goto(AHEAD) == reasons.OUTSIDE_FENCE
    assert driven.machine.goal_state == states.REFUSED
    assert driven.goto(Goal(1.5, 0.5, None, 0.05, 0.05)) == reasons.OK
    assert modes.set_fence(driven.machine, None, Pose(0.0, 0.0, 0.0)) == reasons.OK
    assert driven.goto(AHEAD) == reasons.OK


def test_fence_must_contain_the_robot_and_its_active_goal() -> None:
    driven = driving()
    here, there = driven.state.odometry.pose, Pose(9.0, 9.0, 0.0)
    assert modes.set_fence(driven.machine, AROUND, there) == reasons.FENCE_LEAVES_ROBOT_OUT
    assert modes.set_fence(driven.machine, AROUND, here) == reasons.OUTSIDE_FENCE
    bow_tie = polygon([(0.0, 0.0), (4.0, 4.0), (4.0, 0.0), (0.0, 4.0)])
    assert modes.set_fence(driven.machine, bow_tie, here) == reasons.FENCE_NOT_SIMPLE
    refused = modes.set_fence(driven.machine, WIDE, here, (bow_tie,))
    assert refused == reasons.FENCE_NOT_SIMPLE, "an exclusion is a fence, too"
    assert driven.machine.fence is None, "what was refused is not put up"
    assert modes.set_fence(driven.machine, WIDE, here) == reasons.OK
    modes.abort(driven.machine, 0)
    assert modes.set_fence(driven.machine, AROUND, here) == reasons.OK, "a dead goal is no goal"


def test_the_way_back_is_refused_if_it_leads_out_of_the_fence() -> None:
    driven = driving()
    driven.forward(6.0)
    here = driven.state.odometry.pose
    assert here.x_m > 1.2
    modes.abort(driven.machine, driven.now_ms)
    modes.set_fence(driven.machine, Fence((here.x_m,), (here.y_m,), 0.3), here)
    assert modes.rtl(driven.machine, driven.state.trail, 0) == reasons.OUTSIDE_FENCE
    modes.set_fence(driven.machine, WIDE, here)
    assert modes.rtl(driven.machine, driven.state.trail, 0) == reasons.OK


HERE = Pose(0.0, 0.0, 0.0)
FENCE_AROUND = Fence((0.0,), (0.0,), 2.0)
ELSEWHERE = Fence((9.0,), (0.0,), 2.0)


def shown(machine: Machine) -> tuple[int, int]:
    return machine.vehicle, machine.vehicle_reason


@pytest.fixture
def machine() -> Machine:
    """Return a machine in STANDBY that has lost its saved fence."""
    driven = Driven()
    modes.lose_fence(driven.machine)
    assert shown(driven.machine) == (states.BOOT, reasons.FENCE_UNREADABLE)
    driven.tick()
    return driven.machine


def test_robot_has_its_fence_at_birth() -> None:
    driven = Driven()
    driven.tick()
    assert modes.arm(driven.machine) == reasons.OK
    assert driven.machine.vehicle_reason == reasons.OK


def test_lost_fence_forbids_arming_and_is_shown(machine: Machine) -> None:
    assert shown(machine) == (states.STANDBY, reasons.FENCE_UNREADABLE)
    assert modes.arm(machine) == reasons.FENCE_UNREADABLE
    assert shown(machine) == (states.STANDBY, reasons.FENCE_UNREADABLE)


@pytest.mark.parametrize("fence", [FENCE_AROUND, None], ids=["another", "none"])
def test_lost_fence_is_forgotten_with_another_or_none(
    machine: Machine, fence: Fence | None
) -> None:
    assert modes.set_fence(machine, fence, HERE) == reasons.OK
    assert shown(machine) == (states.STANDBY, reasons.OK)
    assert modes.arm(machine) == reasons.OK
    modes.disarm(machine, 0)
    assert shown(machine) == (states.STANDBY, reasons.OK)


def test_refused_fence_does_not_replace_the_lost_one(machine: Machine) -> None:
    assert modes.set_fence(machine, ELSEWHERE, HERE) == reasons.FENCE_LEAVES_ROBOT_OUT
    assert modes.arm(machine) == reasons.FENCE_UNREADABLE
    assert shown(machine) == (states.STANDBY, reasons.FENCE_UNREADABLE)


def clear(machine: Machine) -> None:
    modes.estop(machine, 0)
    assert shown(machine) == (states.EMERGENCY_STOP, reasons.BY_OPERATOR)
    modes.clear_estop(machine)


def trip_and_disarm(machine: Machine) -> None:
    failsafe.trip(machine, reasons.BUMPER, 0)
    assert shown(machine) == (states.FAILSAFE, reasons.BUMPER)
    assert modes.arm(machine) == reasons.FENCE_UNREADABLE
    modes.disarm(machine, 0)


@pytest.mark.parametrize("change", [clear, trip_and_disarm])
def test_lost_fence_outlasts_stops(machine: Machine, change: Callable[[Machine], None]) -> None:
    change(machine)
    assert shown(machine) == (states.STANDBY, reasons.FENCE_UNREADABLE)
    assert modes.arm(machine) == reasons.FENCE_UNREADABLE


@each("fence", [FENCE_AROUND, None])
def test_fence_leaves_the_reason_of_a_stop_alone(fence: Fence | None) -> None:
    machine = armed().machine
    failsafe.trip(machine, reasons.BUMPER, 0)
    assert modes.set_fence(machine, fence, HERE) == reasons.OK
    assert shown(machine) == (states.FAILSAFE, reasons.BUMPER)


def test_fence_leaves_an_emergency_stop_alone(machine: Machine) -> None:
    modes.estop(machine, 0)
    assert modes.set_fence(machine, None, HERE) == reasons.OK
    assert shown(machine) == (states.EMERGENCY_STOP, reasons.BY_OPERATOR)
    modes.clear_estop(machine)
    assert shown(machine) == (states.STANDBY, reasons.OK)
