"""Laps along a boundary: what they prove, and loops that are noticed."""

from fractions import Fraction
from itertools import pairwise
from math import atan2, cos, hypot, inf, pi, sin

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from robot.core import states
from robot.core.navigators import classical as laps
from robot.core.navigators import loops as way
from robot.core.navigators import proof as chains
from robot.core.navigators import proof as proofs
from robot.core.navigators.classical import Lap
from robot.core.navigators.loops import CRUMBS, HIT_CM, HITS, IN_A_ROW, MIN_AWAY, SPACING_CM, Loops
from robot.core.navigators.proof import (
    AROUND,
    BOUNDARY_M,
    CLOSED,
    DOUBTED,
    HOPPED,
    LEAD,
    MIN_LAP_MM,
    NO_GAP,
    OPEN,
    OPEN_LAP,
    PAST_MM,
    SEPARATED,
    SIGMAS,
    SPENT,
    TAIL,
    WAITING,
    Proof,
)
from robot.core.perception.echoes import BRADS, CIRCLE, HALF_CIRCLE
from robot.core.perception.odometry import Odometry
from robot.core.values import Pose, wrap
from tests.support.cores import HERE, RADIUS_MM, SIDES, SILENT, Disc, Wall, ring, seen_from
from tests.support.each import each

STEP_M = 0.015
EVERY = 3  # ticks per choice
POST: Disc = (0.0, 0.0, 0.5)
ROUND_M = 0.72
"""The robot's way round POST has 0.1 m of room."""
CORNERS = 24
INSIDE_M = 0.78
"""The robot's way inside of `around` has 0.1 m of room."""


def around(missing: int = 0) -> list[Wall]:
    """Return walls round the origin, almost a circle of 1 m; the first ones may be missing."""
    ends = [(cos(2 * pi * k / CORNERS), sin(2 * pi * k / CORNERS)) for k in range(CORNERS + 1)]
    return [(*ends[k], *ends[k + 1]) for k in range(missing, CORNERS)]


def on_circle(radius_m: float, angle_rad: float, turn: int) -> Pose:
    """Return a pose on a circle about the origin, left round (1) or right round (-1)."""
    heading_rad = wrap(angle_rad + turn * 0.5 * pi)
    return Pose(radius_m * cos(angle_rad), radius_m * sin(angle_rad), heading_rad)


def lap(
    proof: Proof,
    radius_m: float,
    turn: int,
    side: int,
    goal: tuple[float, float],
    walls: list[Wall],
    discs: list[Disc],
    *,
    laps: float = 1.4,
    grows_m2: float = 0.0,
) -> int:
    """Drive on a circle, from an angle of pi on; return the first verdict that is not OPEN.

    The variance of the position grows by `grows_m2` each tick.
    """
    before = on_circle(radius_m, pi, turn)
    for tick in range(round(laps * 2.0 * pi * radius_m / STEP_M)):
        pose = on_circle(radius_m, pi + turn * tick * STEP_M / radius_m, turn)
        chains.look(proof.chain, seen_from(pose, walls, discs), before, pose, RADIUS_MM)
        before = pose
        proof.odometry.pxx += grows_m2
        if proof.is_valid:
            proofs.continue_chain(proof, side, RADIUS_MM, *goal)
        if tick == EVERY:
            proofs.mark(proof, pose, side, *goal)
        elif tick % EVERY == 0 and proof.is_valid:
            proofs.advance(proof, pose, *goal)
            found = proofs.verdict(proof, side)
            if found != OPEN:
                return found
    return OPEN


def round_post(goal: tuple[float, float], side: int = states.LEFT) -> int:
    return lap(Proof(), ROUND_M, -side, side, goal, [], [POST])


def inside(goal: tuple[float, float], side: int = states.LEFT, missing: int = 0) -> int:
    return lap(Proof(), INSIDE_M, side, side, goal, around(missing), [])


@SIDES
@pytest.mark.parametrize("goal", [(0.0, 0.0), (0.1, -0.2)])
def test_lap_round_the_goal_separates(side: int, goal: tuple[float, float]) -> None:
    assert round_post(goal, side) == SEPARATED


@SIDES
@pytest.mark.parametrize("goal", [(3.0, 0.0), (-1.2, 0.9), (0.0, -9.0)])
def test_lap_round_an_island_does_not_separate(side: int, goal: tuple[float, float]) -> None:
    assert round_post(goal, side) == AROUND


@pytest.mark.sweep(5)
@SIDES
@pytest.mark.parametrize("goal", [(3.0, 0.0), (-1.2, 0.9), (0.0, -9.0)])
def test_lap_inside_of_walls_separates_from_outside(side: int, goal: tuple[float, float]) -> None:
    assert inside(goal, side) == SEPARATED


@SIDES
def test_lap_inside_of_walls_with_the_goal_does_not_separate(side: int) -> None:
    assert inside((0.1, 0.2), side) == AROUND


@pytest.mark.sweep(3)
@SIDES
@pytest.mark.parametrize("missing", [2, 5])
def test_gap_for_the_robot_makes_the_lap_prove_nothing(side: int, missing: int) -> None:
    """Two of the walls leave a gap of 0.52 m."""
    assert inside((3.0, 0.0), side, missing) == OPEN


def test_goal_nearer_than_the_doubt_is_doubted() -> None:
    """With 0.1 m the true goal may be 0.4 m from its estimate, and 0.25 m beyond the wall."""
    for doubt_m, found in ((0.0, SEPARATED), (0.1, DOUBTED)):
        proof = Proof()
        proof.odometry.pxx = proof.odometry.pyy = doubt_m * doubt_m
        assert lap(proof, INSIDE_M, 1, states.LEFT, (1.25, 0.0), around(), []) == found


def test_doubt_gained_on_the_lap_keeps_it_open() -> None:
    """At the end another place could be taken for the mark."""
    ticks = 2.0 * pi * INSIDE_M / STEP_M
    for gained_m, found in ((0.02, SEPARATED), (0.2, OPEN)):
        proof, grows_m2 = Proof(), gained_m * gained_m / ticks
        way = (INSIDE_M, 1, states.LEFT, (6.0, 0.0), around())
        assert lap(proof, *way, [], grows_m2=grows_m2) == found


def ends(proof: Proof) -> tuple[int, int]:
    return proof.closed_x_mm, proof.closed_y_mm


def test_lap_is_open_until_it_has_passed_the_mark() -> None:
    length_m = 2.0 * pi * INSIDE_M
    for turns, found in ((0.95, OPEN), (1.0, OPEN), (1.3, SEPARATED)):
        proof = Proof()
        way = (INSIDE_M, 1, states.LEFT, (3.0, 0.0), around())
        assert lap(proof, *way, [], laps=turns) == found
    assert 1000.0 * length_m > MIN_LAP_MM
    past_mm = hypot(
        *(a - b for a, b in zip(chains.middle(proof.chain, TAIL), ends(proof), strict=True))
    )
    assert past_mm == pytest.approx(PAST_MM, abs=50)


@each("drift_m", [0.0, 0.05])
def test_lap_is_open_again_if_the_chain_passes_by_its_first_arc(drift_m: float) -> None:
    """The robot was near the mark, but the chain goes on without reaching its first arc.

    It began on one side of an opening and ended on the other. The drift makes no difference.
    """
    proof = marked()
    proof.odometry.pxx += drift_m * drift_m
    proof.way_mm, proof.is_attached, proof.closed, proof.separates = 5000, True, CLOSED, True
    for end in (TAIL, LEAD):
        proof.chain.x_mm[end] = proof.chain.left_x_mm[end] = 2000
    assert proofs.verdict(proof, states.LEFT) == OPEN
    assert proof.closed == OPEN_LAP


def test_mark_without_an_echo_begins_no_lap() -> None:
    proof = Proof()
    chains.look(proof.chain, SILENT, HERE, HERE, RADIUS_MM)
    proofs.mark(proof, HERE, states.LEFT, 3.0, 0.0)
    assert not proof.is_valid
    assert proofs.verdict(proof, states.LEFT) == OPEN


def marked(odometry: Odometry | None = None) -> Proof:
    """Return a lap that begins at HERE beside an echo on the right; the goal is at 3, 0."""
    proof = Proof()
    if odometry is not None:
        proof.odometry = odometry
    for _ in range(2):
        chains.look(proof.chain, ring({0: 100, 1: 120}), HERE, HERE, RADIUS_MM)
    proofs.mark(proof, HERE, states.LEFT, 3.0, 0.0)
    return proof


def test_mark_begins_a_lap_of_length_zero() -> None:
    proof = marked()
    assert proof.is_valid
    assert (proof.way_mm, proof.turned, proofs.goal_winding(proof), proofs.mark_winding(proof)) == (
        0,
        0,
        0,
        0,
    )
    assert (proof.closed, proof.gap, proof.room_m) == (OPEN_LAP, NO_GAP, inf)


def test_voided_lap_proves_nothing_until_the_next_mark() -> None:
    proof = Proof()
    assert lap(proof, INSIDE_M, 1, states.LEFT, (3.0, 0.0), around(), []) == SEPARATED
    assert proofs.verdict(proof, states.LEFT) == SEPARATED
    proofs.void(proof)
    assert proofs.verdict(proof, states.LEFT) == OPEN
    assert lap(proof, INSIDE_M, 1, states.LEFT, (3.0, 0.0), around(), []) == SEPARATED


def test_chain_that_stays_behind_waits() -> None:
    proof, way_m = marked(), 0.0
    while proof.gap != WAITING and way_m < 2.0:
        way_m += STEP_M
        pose = Pose(way_m, 0.0, 0.0)
        proofs.advance(proof, pose, 3.0, 0.0)
        chains.look(proof.chain, SILENT, pose, pose, RADIUS_MM)
        proofs.continue_chain(proof, states.LEFT, RADIUS_MM, 3.0, 0.0)
        assert not proof.is_attached
    assert 0.4 < way_m < 0.6


def test_way_and_turns_add_up() -> None:
    proof = marked()
    for k in range(1, 41):
        proofs.advance(proof, on_circle(1.0, -pi + 0.05 * k, 1), 3.0, 0.0)
    start_m = 1.0  # from HERE to the circle
    assert proof.way_mm == pytest.approx(1000.0 * (start_m + 0.05 * 39), abs=45)
    assert proof.turned == pytest.approx(CIRCLE * (2.0 - 0.5 * pi) / (2.0 * pi), abs=2)


@given(st.floats(0.0, 0.2), st.lists(st.tuples(st.floats(-5, 5), st.floats(-5, 5)), min_size=1))
def test_room_is_least_distance_without_the_doubt(
    doubt_m: float, places: list[tuple[float, float]]
) -> None:
    odometry = Odometry()
    odometry.pxx, odometry.pyy = doubt_m * doubt_m, 0.0
    proof = marked(odometry)
    for x_m, y_m in places:
        proofs.advance(proof, Pose(x_m, y_m, 0.0), 3.0, 0.0)
    least_m = min(hypot(x_m - 3.0, y_m) for x_m, y_m in places)
    assert proof.room_m == pytest.approx(least_m - BOUNDARY_M - SIGMAS * doubt_m, abs=1e-9)


@given(st.floats(0.0, 0.5), st.floats(0.0, 0.5), st.floats(-pi, pi))
def test_doubt_is_of_the_most_uncertain_direction(
    long_m: float, short_m: float, angle_rad: float
) -> None:
    c, s, a, b = cos(angle_rad), sin(angle_rad), long_m * long_m, short_m * short_m
    odometry = Odometry()
    odometry.pxx, odometry.pyy = a * c * c + b * s * s, a * s * s + b * c * c
    odometry.pxy = (a - b) * c * s
    assert proofs.position_sigma_m(odometry) == pytest.approx(max(long_m, short_m), abs=1e-7)


@given(st.integers(-CIRCLE, CIRCLE), st.integers(-HALF_CIRCLE, HALF_CIRCLE - 1))
def test_turn_is_the_shorter_way(before: int, turned: int) -> None:
    assert proofs.turn(before, before + turned) == turned
    assert proofs.turn(before, before + turned + CIRCLE) == turned


@given(st.integers(-3, 3), st.integers(-HALF_CIRCLE, HALF_CIRCLE - 1))
def test_winding_number_is_the_nearest_whole_turn(turns: int, more: int) -> None:
    assert proofs.winding_number(turns * CIRCLE + more) == turns


def test_lines_turn_along_the_chain_round_the_robot() -> None:
    """The chain leads from 124 degrees past the front to -79 degrees; the shortest turn is left."""
    proof, all_round = Proof(), ring(dict.fromkeys(range(8), 60))
    for heading_rad in (0.25 * pi, 0.25 * pi, 0.0):
        pose = Pose(0.0, 0.0, heading_rad)
        chains.look(proof.chain, all_round, pose, pose, RADIUS_MM)
        if not proof.is_valid:
            proofs.mark(proof, pose, states.RIGHT, 9.0, 0.0)
    assert proofs.mark_winding(proof) == 0
    proofs.continue_chain(proof, states.LEFT, RADIUS_MM, 9.0, 0.0)
    assert proofs.mark_winding(proof) == pytest.approx(-CIRCLE * 202.5 / 360.0, abs=10)
    assert abs(proofs.goal_winding(proof)) < 100


def hop(away_m: float, gained_m: float = 0.0) -> Proof:
    """Return a lap whose chain waited while the robot was elsewhere, then met an echo.

    The echo is `away_m` beyond the end of the chain; the position has gained a doubt.
    """
    proof = marked()
    for x_m, range_mm in ((0.3, None), (0.6, None), (0.9, None), (away_m, 100), (away_m, 100)):
        pose = Pose(x_m, 0.0, 0.0)
        proofs.advance(proof, pose, 3.0, 0.0)
        seen = SILENT if range_mm is None else ring({0: range_mm})
        chains.look(proof.chain, seen, pose, pose, RADIUS_MM)
        proofs.continue_chain(proof, states.LEFT, RADIUS_MM, 3.0, 0.0)
        if range_mm is None and x_m > 0.6:
            assert proof.gap == WAITING
            proof.odometry.pxx += gained_m * gained_m
    return proof


def test_chain_hops_to_the_same_surface_beyond_a_gap() -> None:
    assert hop(0.1).gap == HOPPED
    assert hop(0.1).is_attached


def test_chain_does_not_hop_over_a_gap_for_the_robot() -> None:
    assert hop(0.3).gap == WAITING
    assert not hop(0.3).is_attached


def test_hop_needs_room_for_the_doubt() -> None:
    assert hop(0.05, 0.001).gap == HOPPED
    assert hop(0.05, 0.03).gap == WAITING
    assert hop(0.05, 1.0).gap == WAITING


def test_correction_of_the_position_counts_as_doubt_of_a_hop() -> None:
    """A wall that has shrunk the variance has also moved the estimate."""
    proof = Proof()
    proof.odometry.pxx = 0.0004
    before_mm2 = proofs.variance_mm2(proof)
    proof.odometry.pxx = 0.0003
    assert proofs.sigma_gained_mm(proof, before_mm2) == pytest.approx(10.0)
    proof.odometry.pxx = 0.0005
    assert proofs.sigma_gained_mm(proof, before_mm2) == pytest.approx(10.0)


def test_spent_lap_is_void_at_the_next_gap() -> None:
    proof, way_m = marked(), 0.0
    proof.gap = SPENT
    assert proofs.verdict(proof, states.LEFT) == OPEN
    while proof.is_valid and way_m < 9.0:
        way_m += STEP_M
        proofs.advance(proof, Pose(way_m, 0.0, 0.0), 3.0, 0.0)
        chains.look(proof.chain, SILENT, HERE, HERE, RADIUS_MM)
        proofs.continue_chain(proof, states.LEFT, RADIUS_MM, 3.0, 0.0)
    assert way_m == pytest.approx(0.45, abs=0.1)


def test_turn_waits_with_the_chain() -> None:
    proof = marked()
    proof.gap = WAITING
    proofs.advance(proof, Pose(0.1, 0.0, 2.0), 3.0, 0.0)
    assert proof.turned == 0
    proof.gap = HOPPED
    proofs.advance(proof, Pose(0.2, 0.0, 0.1), 3.0, 0.0)
    assert proof.turned == pytest.approx(CIRCLE * 0.1 / (2.0 * pi), abs=1)


def begun(pose: Pose) -> Lap:
    lap = Lap()
    laps.begin(lap, pose)
    return lap


def lap_on_circle(radius_m: float, angle_rad: float) -> Pose:
    """Return a pose on a counter-clockwise circle about the origin."""
    x_m, y_m = radius_m * cos(angle_rad), radius_m * sin(angle_rad)
    return Pose(x_m, y_m, wrap(angle_rad + 0.5 * pi))


def closings(poses: list[Pose]) -> list[int]:
    """Return the ticks at which a lap was closed."""
    lap = begun(poses[0])
    return [k for k, pose in enumerate(poses) if laps.closes_lap(lap, pose)]


def circle(radius_m: float, turns: float) -> list[Pose]:
    ticks = round(turns * 2.0 * pi * radius_m / STEP_M)
    return [lap_on_circle(radius_m, k * STEP_M / radius_m) for k in range(ticks)]


@given(st.floats(0.17, 5.0), st.booleans())
def test_every_lap_is_detected_once(radius_m: float, mirrored: bool) -> None:
    poses = circle(radius_m, 3.6)
    if mirrored:
        poses = [Pose(x_m, -y_m, -heading_rad) for x_m, y_m, heading_rad in poses]
    assert 3 <= len(closings(poses)) <= 4
    assert not closings(poses[: len(poses) // 5])


def test_return_through_a_corridor_is_no_lap() -> None:
    there = [Pose(k * STEP_M, 0.0, 0.0) for k in range(200)]
    turn = [Pose(3.0, 0.2 * k / 30, pi * k / 30) for k in range(31)]
    back = [Pose(3.0 - k * STEP_M, 0.2, pi) for k in range(200)]
    assert not closings(there + turn + back)


def test_same_pose_without_a_full_turn_is_no_lap() -> None:
    there = [Pose(k * STEP_M, 0.0, 0.0) for k in range(100)]
    left = [Pose(1.5, 0.0, pi * k / 30) for k in range(31)]
    back = [Pose(1.5 - k * STEP_M, 0.0, pi) for k in range(100)]
    right = [Pose(0.0, 0.0, pi - pi * k / 30) for k in range(31)]
    assert not closings(there + left + back + right + there)


def test_a_robot_that_can_only_spin_is_boxed_in() -> None:
    spun = [Pose(1.0, 1.0, wrap(0.1 * k)) for k in range(200)]
    assert closings(spun)
    assert not closings(spun[:120])


def test_turns_off_the_boundary_count_but_distance_does_not() -> None:
    lap = begun(Pose(0.0, 0.0, 0.0))
    laps.resume(lap, Pose(5.0, 0.0, 1.0))
    assert not laps.closes_lap(lap, Pose(5.01, 0.0, 1.5))
    assert abs(lap.turned_rad - 1.5) < 1e-9
    assert abs(lap.at_m - 0.01) < 1e-9


def test_a_mark_on_another_boundary_is_replaced() -> None:
    elsewhere = [Pose(k * STEP_M, 0.0, 0.0) for k in range(100)]
    poses = elsewhere + [Pose(x_m + 9.0, y_m, h_rad) for x_m, y_m, h_rad in circle(0.5, 4.5)]
    assert len(closings(poses)) >= 2


LEFT, RIGHT = 1, -1


def walk_round(loops: Loops, radius_cm: float, laps: float, turn: int = 1) -> float | None:
    """Walk around a circle in small steps; return the number of laps until detection."""
    steps = round(laps * 2.0 * pi * radius_cm / 4.0)
    for k in range(steps):
        angle_rad = turn * 4.0 * k / radius_cm
        x_cm, y_cm = radius_cm * cos(angle_rad), radius_cm * sin(angle_rad)
        heading = int(BRADS * (angle_rad + turn * 0.5 * pi))
        if way.drop(loops, int(x_cm), int(y_cm), heading):
            return 4.0 * k / (2.0 * pi * radius_cm)
    return None


def walk_along(loops: Loops, *places: tuple[float, float]) -> bool:
    """Walk straight from place to place, turning on the spot at each."""
    for (x0, y0), (x1, y1) in pairwise(places):
        heading = int(BRADS * atan2(y1 - y0, x1 - x0))
        steps = int(max(abs(x1 - x0), abs(y1 - y0)) / 4.0)
        for k in range(steps + 1):
            x_cm, y_cm = x0 + (x1 - x0) * k / steps, y0 + (y1 - y0) * k / steps
            if way.drop(loops, int(x_cm), int(y_cm), heading):
                return True
    return False


@each("turn", [1, -1])
@each("radius_cm", [60.0, 150.0, 300.0])
def test_a_closed_way_is_noticed_early_in_its_second_lap(radius_cm: float, turn: int) -> None:
    laps = walk_round(Loops(), radius_cm, 2.0, turn)
    assert laps is not None
    assert 1.0 - 2.0 * SPACING_CM / radius_cm < laps < 1.5


@each("radius_cm", [500.0, 1000.0, 2500.0])
def test_long_way_is_thinned_and_still_detected(radius_cm: float) -> None:
    assert 2.0 * pi * radius_cm > CRUMBS * SPACING_CM
    loops = Loops()
    laps = walk_round(loops, radius_cm, 4.0)
    assert laps is not None
    assert loops.spacing_cm > SPACING_CM
    assert loops.count <= CRUMBS


@each("times", [1, 4])
def test_there_and_back_along_a_corridor_is_no_loop(times: int) -> None:
    """Visit the same places in the other direction."""
    loops = Loops()
    assert not walk_along(loops, (0.0, 0.0), (400.0, 0.0), (0.0, 0.0))
    assert not walk_along(loops, (0.0, 60.0), (0.0, 460.0), (0.0, 60.0))


def test_the_same_places_in_the_same_direction_are_a_loop() -> None:
    corridor = (0.0, 0.0), (400.0, 0.0), (400.0, 60.0), (0.0, 60.0), (0.0, 0.0)
    assert walk_along(Loops(), *corridor, (200.0, 0.0))
    assert not walk_along(Loops(), *corridor)


def test_crossing_the_own_way_is_no_loop() -> None:
    eight = (0.0, 0.0), (300.0, 0.0), (300.0, 200.0), (150.0, 200.0), (150.0, -200.0)
    assert not walk_along(Loops(), *eight)


def test_a_single_place_seen_again_is_no_loop_yet() -> None:
    loops = Loops()
    walk_along(loops, (0.0, 0.0), (400.0, 0.0))
    assert IN_A_ROW > 1
    assert not way.drop(loops, 0, 0, 0)
    assert loops.matches == 1
    assert not way.drop(loops, 1000, 1000, 0)
    assert loops.matches == 0


def test_stationary_robot_stores_one_point() -> None:
    loops = Loops()
    for heading in range(0, 4096, 64):
        assert not way.drop(loops, 10, 10, heading)
    assert loops.count == 1


def test_the_newest_crumbs_are_no_earlier_visit() -> None:
    loops = Loops()
    for k in range(MIN_AWAY):
        way.drop(loops, k * SPACING_CM, 0, 0)
    assert way.visited(loops, 0, 0, 0) == -1
    way.drop(loops, MIN_AWAY * SPACING_CM, 0, 0)
    assert way.visited(loops, 0, 0, 0) == 0
    assert way.visited(loops, 0, 0, 128) == -1


def test_the_way_is_as_long_as_it_was_walked_also_when_thinned() -> None:
    loops, length_cm = Loops(), 0.0
    for k in range(1500):
        length_cm = 4.0 * k
        way.drop(loops, int(length_cm), 0, 0)
    assert loops.spacing_cm > SPACING_CM
    assert way.walked_cm(loops) == pytest.approx(length_cm, rel=0.2)
    way.restart(loops)
    assert way.walked_cm(loops) == 0
    assert loops.spacing_cm == SPACING_CM


def test_at_the_same_place_the_other_side_is_tried() -> None:
    loops = Loops()
    assert way.side_at(loops, 100, 100, LEFT) == LEFT
    way.remember(loops, 100, 100, LEFT)
    assert way.side_at(loops, 100 + HIT_CM // 2, 100, LEFT) == RIGHT
    assert way.side_at(loops, 100 + HIT_CM // 2, 100, RIGHT) == RIGHT
    assert way.side_at(loops, 100 + HIT_CM, 100, LEFT) == LEFT


def test_of_two_hits_at_a_place_the_newer_counts() -> None:
    loops = Loops()
    way.remember(loops, 0, 0, LEFT)
    way.remember(loops, 5, 0, RIGHT)
    assert way.side_at(loops, 0, 0, RIGHT) == LEFT


def test_only_so_many_hits_are_kept_and_the_oldest_goes() -> None:
    loops = Loops()
    for k in range(HITS + 1):
        way.remember(loops, 1000 * k, 0, LEFT)
    assert way.side_at(loops, 0, 0, LEFT) == LEFT
    assert all(way.side_at(loops, 1000 * k, 0, LEFT) == RIGHT for k in range(1, HITS + 1))
    assert len(loops.hit_place) == len(loops.hit_side) == HITS


def test_after_a_hit_the_way_begins_anew() -> None:
    loops = Loops()
    walk_along(loops, (0.0, 0.0), (400.0, 0.0))
    way.remember(loops, 400, 0, LEFT)
    assert way.walked_cm(loops) == 0


def closed_way(corners: list[tuple[int, int]], before: int = 0) -> Loops:
    """Return a loop through these places, with a few points before it."""
    loops = Loops()
    places = [(-900, 800)] * before + corners
    for k, (x_cm, y_cm) in enumerate(places):
        loops.place[k] = way.packed(x_cm, y_cm)
    loops.count, loops.first = len(places), before
    return loops


def crossings_cm(corners: list[tuple[int, int]], x_cm: int, y_cm: int) -> list[Fraction]:
    """Return where the line to the right and left of a place crosses the loop, exactly."""
    found = []
    for (x1, y1), (x2, y2) in zip(corners, [*corners[1:], corners[0]], strict=True):
        if (y1 > y_cm) != (y2 > y_cm):
            found.append(x1 - x_cm + Fraction((x2 - x1) * (y_cm - y1), y2 - y1))
    return found


coordinates = st.integers(-600, 600)
corners = st.lists(st.tuples(coordinates, coordinates), min_size=3, max_size=20)


@given(corners, coordinates, coordinates, st.integers(0, 9))
def test_places_inside_and_outside_a_loop_are_distinguished(
    corners: list[tuple[int, int]], x_cm: int, y_cm: int, before: int
) -> None:
    """Test any winding of the loop, except for places within a centimetre of it."""
    met = crossings_cm(corners, x_cm, y_cm)
    assume(all(abs(x) > 1 for x in met))
    inside = sum(1 for x in met if x > 0) % 2 == 1
    assert way.encloses(closed_way(corners, before), x_cm, y_cm) == inside


@given(
    st.lists(st.integers(60, 400), min_size=8, max_size=30),
    st.sampled_from([1, -1]),
    coordinates,
    coordinates,
    st.integers(0, 9),
)
def test_a_loop_round_a_place_turns_as_it_was_walked(
    radii_cm: list[int], turn: int, x_cm: int, y_cm: int, before: int
) -> None:
    step_rad = turn * 2.0 * pi / len(radii_cm)
    star = [
        (x_cm + int(r * cos(k * step_rad)), y_cm + int(r * sin(k * step_rad)))
        for k, r in enumerate(radii_cm)
    ]
    loops = closed_way(star, before)
    assert way.turns_left(loops) == (turn > 0)
    assert way.encloses(loops, x_cm, y_cm)


@given(
    st.lists(st.tuples(coordinates, coordinates, st.integers(-5000, 5000)), max_size=400),
)
def test_wherever_it_goes_nothing_grows(story: list[tuple[int, int, int]]) -> None:
    loops = Loops()
    for x_cm, y_cm, heading in story:
        way.drop(loops, x_cm, y_cm, heading)
        assert 0 < loops.count <= CRUMBS
        assert 0 <= loops.first < CRUMBS
    assert len(loops.place) == len(loops.heading) == CRUMBS


@each("heading_rad", [0.0, 0.7, 2.5])
def test_way_without_a_bend_is_straight(heading_rad: float) -> None:
    loops = Loops()
    assert not way.is_straight(loops)
    for k in range(60):
        way.drop(loops, int(4.0 * k * cos(heading_rad)), int(4.0 * k * sin(heading_rad)), 0)
    assert loops.count > 5
    assert way.is_straight(loops)


@each("end", [(200.0, 150.0), (0.0, 0.0), (300.0, 250.0)])
def test_way_with_a_bend_is_not_straight(end: tuple[float, float]) -> None:
    loops = Loops()
    walk_along(loops, (0.0, 0.0), (200.0, 0.0), end)
    assert not way.is_straight(loops)
