"""The navigator with a map: cells, evidence of echoes, costs and routes."""

from math import inf

import numpy as np
import pytest

from plant.corpus.generate import generate
from plant.world.file import load
from protocol.outcome import RunOutcome
from protocol.world import World
from robot.core.navigators.registry import NAVIGATORS as OF_ROBOT
from robot.core.parameters import DEFAULTS
from robot.core.perception.echoes import CIRCLE, QUARTER
from robot.core.perception.sonar_ring import Ring
from robot.core.values import Goal, Pose
from robot.parameter_table import OutOfRangeError
from runtime.elementary import atan2
from study.oracle.grid_map import (
    BLOCKED_MM,
    CELL_MM,
    CLOSE,
    DOUBTFUL,
    FREE,
    LEAST_NEAR,
    MAYBE,
    MOST,
    MOST_MANY,
    PASSED,
    REACH_MM,
    SURE,
    CellEvidence,
    GridMap,
    Terrain,
    brads,
    change,
    cones_of,
    price_all,
    search_route,
    take,
    terrain_of,
    update_evidence,
)
from study.oracle.names import ORACLE_GRID
from study.oracle.oracle_grid import OracleMemory, away_from_flank, registered, step
from study.trial.trial import Trial, run_trial
from tests.support.each import each

WIDTH = 1000


def test_bearings_equal_the_arc_tangent() -> None:
    x_mm, y_mm = (each.ravel() for each in np.mgrid[-300:301:37, -300:301:41])
    found = brads(x_mm, y_mm).tolist()
    for x, y, bearing in zip(x_mm.tolist(), y_mm.tolist(), found, strict=True):
        expected = atan2(float(y), float(x)) * QUARTER / (3.141592653589793 / 2.0)
        assert abs((bearing - expected + CIRCLE / 2) % CIRCLE - CIRCLE / 2) < 0.6


@each("heading", [0, QUARTER, 3 * QUARTER])
def test_cone_is_one_slice_of_cells(heading: int) -> None:
    cones = cones_of(0, 0, WIDTH)
    first = heading + CIRCLE
    cells = cones.offset[cones.first[first - 128] : cones.first[first + 128]]
    along = {0: 1, QUARTER: WIDTH, 3 * QUARTER: -WIDTH}[heading]
    reach = REACH_MM // CELL_MM - 1
    assert {along * k for k in range(3, reach)} <= set(cells.tolist())
    assert not {-along * k for k in range(3, reach)} & set(cells.tolist())


def test_every_cell_in_reach_is_in_a_circle_once() -> None:
    cones = cones_of(1, 0, WIDTH)
    circle = cones.offset[cones.first[CIRCLE] : cones.first[2 * CIRCLE - 1]].tolist()
    assert len(circle) == len(set(circle))
    assert abs(len(circle) - 3.1416 * (REACH_MM / CELL_MM) ** 2) < 400
    assert int(cones.distance_mm.max()) <= REACH_MM


RADIUS_MM = 120
AHEAD_MM = 100 + RADIUS_MM


def grid() -> CellEvidence:
    return CellEvidence(-200, -200, 400, 400)


def ring_with(ranges: dict[int, float | None], other: float | None = None) -> Ring:
    ring = Ring()
    ring.range_m = [ranges.get(i, other) for i in range(8)]
    return ring


def at(evidence: CellEvidence, x_mm: int, y_mm: int) -> int:
    return int(evidence.score[evidence.index(x_mm, y_mm)])


def test_near_echo_is_certain_after_two_looks() -> None:
    evidence, ring = grid(), ring_with({3: 0.10})
    update_evidence(evidence, 0, 0, 128, ring, RADIUS_MM)
    assert MAYBE <= at(evidence, AHEAD_MM, 0) < SURE
    update_evidence(evidence, 0, 0, 128, ring, RADIUS_MM)
    assert at(evidence, AHEAD_MM, 0) >= SURE
    assert at(evidence, AHEAD_MM - 60, 0) < 0


def test_far_echo_stays_doubtful() -> None:
    evidence, ring = grid(), ring_with({3: 1.2})
    for _ in range(30):
        update_evidence(evidence, 0, 0, 128, ring, RADIUS_MM)
    assert at(evidence, 1200 + RADIUS_MM, 0) == MOST_MANY
    assert MOST_MANY < SURE


def test_longer_echo_clears_what_was_occupied() -> None:
    evidence = grid()
    for _ in range(4):
        update_evidence(evidence, 0, 0, 128, ring_with({3: 0.10}), RADIUS_MM)
    assert at(evidence, AHEAD_MM, 0) >= SURE
    for _ in range(30):
        update_evidence(evidence, 0, 0, 128, ring_with({3: inf}), RADIUS_MM)
    assert at(evidence, AHEAD_MM, 0) == LEAST_NEAR


def test_one_lost_echo_does_not_clear_a_wall() -> None:
    evidence = grid()
    for _ in range(4):
        update_evidence(evidence, 0, 0, 128, ring_with({3: 0.10}), RADIUS_MM)
    update_evidence(evidence, 0, 0, 128, ring_with({3: inf}), RADIUS_MM)
    assert at(evidence, AHEAD_MM, 0) >= SURE


def test_missing_measurement_changes_nothing() -> None:
    evidence = grid()
    cells, before = update_evidence(evidence, 0, 0, 0, ring_with({}), RADIUS_MM)
    assert not evidence.score.any()
    assert len(cells) == len(before) == 0


def test_known_obstacle_explains_its_arc() -> None:
    score = np.array([SURE, 0, 0, 0], dtype=np.int16)
    take(score, np.array([0, 1, 2, 3]))
    assert score.tolist() == [SURE + 1, 0, 0, 0]


def test_echo_comes_from_a_cell_that_no_echo_passed() -> None:
    score = np.array([PASSED, 0, PASSED, PASSED], dtype=np.int16)
    for _ in range(6):
        take(score, np.arange(4))
    assert score.tolist() == [PASSED, MOST, PASSED, PASSED]


def test_arc_of_free_cells_is_doubted() -> None:
    score = np.full(4, PASSED, dtype=np.int16)
    take(score, np.arange(4))
    assert (score > PASSED).all()


@each("heading", [0, 700, -3000, 9000])
def test_cells_are_reported_once_with_their_score_before(heading: int) -> None:
    evidence, ring = grid(), ring_with({1: 0.2, 4: 0.3, 6: 0.05}, inf)
    update_evidence(evidence, 30, 50, heading, ring, RADIUS_MM)
    old = evidence.score.copy()
    cells, before = update_evidence(evidence, 30, 50, heading, ring, RADIUS_MM)
    assert len(set(cells.tolist())) == len(cells) > 0
    assert (old[cells] == before).all()
    changed = np.flatnonzero((old >= MAYBE) != (evidence.score >= MAYBE))
    assert set(changed.tolist()) <= set(cells.tolist())


def drive(world: World, noise: str = "none", navigator: str = "oracle_grid") -> RunOutcome:
    return run_trial(Trial(world=world, navigator=navigator, noise=noise, timeout_s=400.0))


@each("name", ["open", "box", "u_trap", "zigzag", "corner"])
def test_goal_is_reached_without_contact(name: str) -> None:
    found = drive(load(name))
    assert found.reached
    assert found.contacts == 0


def test_goal_is_reached_with_noise() -> None:
    found = drive(load("u_trap"), "default")
    assert found.reached
    assert found.contacts == 0


def test_way_is_shorter_than_with_a_small_memory() -> None:
    world = load("zigzag")
    assert drive(world).path_m < 0.8 * drive(world, navigator="vgm_memory").path_m


def test_unreachable_goal_is_recognised() -> None:
    found = drive(generate("unreachable", 1, 31))
    assert found.outcome == "unreachable"


def test_same_seed_gives_the_same_drive() -> None:
    world = load("box")
    assert drive(world, "default").digest == drive(world, "default").digest


def test_table_of_the_robot_stays_as_it_was() -> None:
    before = dict(OF_ROBOT)
    drive(load("open"))
    assert before == OF_ROBOT
    with registered(ORACLE_GRID):
        assert ORACLE_GRID in OF_ROBOT
    assert before == OF_ROBOT


def test_parameter_cannot_choose_a_study_only_navigator() -> None:
    chosen = {"navigator": float(ORACLE_GRID)}
    with pytest.raises(OutOfRangeError):
        run_trial(Trial(world=load("open"), parameters=chosen))


def test_map_grows_where_the_robot_drives() -> None:
    grid = GridMap((0, 0), (1000, 1000))
    grid.mark(500, 500)
    assert grid.has_room(500, 500)
    assert not grid.has_room(4500, 500)
    wider = grid.extended(4500, 500)
    assert wider.has_room(4500, 500)
    assert wider.has_room(-1000, 500)
    for place in ((500, 500), (3000, 500), (-2000, 2000)):
        assert wider.terrain.cost[wider.cell_of(*place)] == grid.terrain.cost[grid.cell_of(*place)]


def test_robot_that_is_held_up_marks_the_place_ahead() -> None:
    memory, goal = OracleMemory(), Goal(2.0, 0.0, None, 0.05, 0.05)
    ring = ring_with({}, inf)
    for _ in range(80):
        step(memory, Pose(0.0, 0.0, 0.0), ring, goal, DEFAULTS)
    assert memory.grid is not None
    assert memory.grid.line_cost(0, 0, 2000, 0) == 0
    assert not memory.sees_goal


def test_new_goal_begins_with_an_empty_map() -> None:
    memory, ring = OracleMemory(), ring_with({3: 0.1, 4: 0.1}, inf)
    for _ in range(9):
        step(memory, Pose(0.0, 0.0, 0.0), ring, Goal(2.0, 0.0, None, 0.05, 0.05), DEFAULTS)
    assert memory.grid is not None
    assert (memory.grid.evidence.score > 0).any()
    step(memory, Pose(0.0, 0.0, 0.0), Ring(), Goal(2.0, 1.0, None, 0.05, 0.05), DEFAULTS)
    assert not (memory.grid.evidence.score > 0).any()


def test_robot_turns_away_from_a_flank_that_it_almost_touches() -> None:
    assert away_from_flank(ring_with({0: 0.02}, inf), -0.5) == 0.3
    assert away_from_flank(ring_with({7: 0.02}, inf), 0.5) == -0.3
    assert away_from_flank(ring_with({0: 0.02, 7: 0.02}, inf), 0.5) == 0.5
    assert away_from_flank(ring_with({0: 0.02}, inf), 0.8) == 0.8


ROUTE_WIDTH = 12


def plain(*blocked: int) -> bytearray:
    cost = bytearray([4] * ROUTE_WIDTH * ROUTE_WIDTH)
    for k in range(ROUTE_WIDTH):
        for rim in (
            k,
            ROUTE_WIDTH * (ROUTE_WIDTH - 1) + k,
            k * ROUTE_WIDTH,
            k * ROUTE_WIDTH + ROUTE_WIDTH - 1,
        ):
            cost[rim] = 0
    for cell in blocked:
        cost[cell] = 0
    return cost


def test_route_in_the_open_is_straight() -> None:
    start = 5 * ROUTE_WIDTH + 2
    assert search_route(plain(), ROUTE_WIDTH, start, start + 6, 4) == list(range(start, start + 7))


def test_route_leads_round_a_wall() -> None:
    wall = [row * ROUTE_WIDTH + 6 for row in range(1, 9)]
    found = search_route(plain(*wall), ROUTE_WIDTH, 5 * ROUTE_WIDTH + 3, 5 * ROUTE_WIDTH + 9, 4)
    assert 9 * ROUTE_WIDTH + 6 in found
    assert not set(found) & set(wall)


def test_there_is_no_route_through_a_closed_wall() -> None:
    wall = [row * ROUTE_WIDTH + 6 for row in range(ROUTE_WIDTH)]
    assert (
        search_route(plain(*wall), ROUTE_WIDTH, 5 * ROUTE_WIDTH + 3, 5 * ROUTE_WIDTH + 9, 4) == []
    )


def test_dear_cells_are_passed_by_if_that_costs_less() -> None:
    cost = plain()
    for row in range(3, 8):
        cost[row * ROUTE_WIDTH + 6] = 100
    found = search_route(cost, ROUTE_WIDTH, 5 * ROUTE_WIDTH + 3, 5 * ROUTE_WIDTH + 9, 4)
    assert not {row * ROUTE_WIDTH + 6 for row in range(3, 8)} & set(found)


def test_start_may_be_the_end() -> None:
    assert search_route(plain(), ROUTE_WIDTH, 5 * ROUTE_WIDTH + 3, 5 * ROUTE_WIDTH + 3, 4) == [
        5 * ROUTE_WIDTH + 3
    ]


SIDE = 100


def terrain_grid() -> CellEvidence:
    return CellEvidence(0, 0, SIDE, SIDE)


def costs(terrain: Terrain) -> list[list[int]]:
    found: list[list[int]] = terrain.costs.reshape(terrain.height, terrain.width).tolist()
    return found


def test_certain_obstacle_blocks_a_disc_around_it() -> None:
    evidence = terrain_grid()
    evidence.score[50 * SIDE + 50] = SURE
    rows = costs(terrain_of(evidence))
    assert rows[25][25] == rows[25][25 + BLOCKED_MM // 40] == 0
    assert rows[25][29] == FREE + CLOSE
    assert rows[25][32] == FREE


def test_doubtful_obstacle_costs_more() -> None:
    evidence = terrain_grid()
    evidence.score[50 * SIDE + 50] = SURE - 1
    rows = costs(terrain_of(evidence))
    assert rows[25][25] == FREE + DOUBTFUL
    assert rows[25][29] == FREE


def test_rim_is_blocked() -> None:
    rows = costs(Terrain(terrain_grid()))
    assert not any(rows[0] + rows[-1] + [row[0] for row in rows] + [row[-1] for row in rows])


def test_narrowest_passage_is_open_wherever_it_lies() -> None:
    for shift in range(4):
        evidence = terrain_grid()
        scores = evidence.score.reshape(SIDE, SIDE)
        scores[10:90, 30 + shift] = scores[10:90, 30 + shift + 15] = MOST
        row = costs(terrain_of(evidence))[25]
        assert any(row[16 + shift // 2 : 23 + shift // 2])


def test_changes_equal_a_new_count() -> None:
    evidence = terrain_grid()
    terrain = terrain_of(evidence)
    cells = np.array([50 * SIDE + 50, 50 * SIDE + 51, 31 * SIDE + 40])
    for scores in ([SURE, 1, MOST], [0, SURE, 1], [1, 0, 0]):
        before = evidence.score[cells]
        evidence.score[cells] = scores
        assert change(terrain, evidence, cells, before)
        price_all(terrain)
        assert costs(terrain) == costs(terrain_of(evidence))
    assert not change(terrain, evidence, cells, evidence.score[cells])
