"""Laps along a boundary: what they prove, and what keeps them from a proof."""

from math import cos, hypot, inf, pi, sin

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robot.core import states
from robot.core.navigators import proof as chains
from robot.core.navigators import proof as proofs
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
from robot.core.perception.echoes import CIRCLE, HALF_CIRCLE
from robot.core.perception.odometry import Odometry
from robot.core.values import Pose, wrap
from tests.support.each import each
from tests.support.robot.core.rings import HERE, RADIUS_MM, SILENT, Disc, Wall, ring, seen_from
from tests.support.robot.core.vgm_memory import SIDES

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
    for laps, found in ((0.95, OPEN), (1.0, OPEN), (1.3, SEPARATED)):
        proof = Proof()
        way = (INSIDE_M, 1, states.LEFT, (3.0, 0.0), around())
        assert lap(proof, *way, [], laps=laps) == found
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
