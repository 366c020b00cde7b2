"""Scores of a trial as other benchmarks publish them, and the lap of an unreachable goal."""

from dataclasses import replace
from math import pi

import pytest

from plant.corpus import generate
from plant.model.configuration import Body
from protocol.world import GoalPose, Polygon, Polyline, Start, World
from study.runner.run_task import FULL_SCORE, lap_m, published_score, spl
from tests.support.each import each

RADIUS_M = Body().radius_m
RING = Polyline(((4.0, 2.0), (6.0, 2.0), (6.0, 4.0), (4.0, 4.0), (4.0, 2.0)), 0.02)
GROWN_M = RADIUS_M + 0.01


@each(("time_s", "score"), [(10.0, 0.5), (20.0, 0.5), (40.0, 0.25), (80.0, 0.125), (400.0, 0.125)])
def test_published_score_is_clipped_at_2_and_8(time_s: float, score: float) -> None:
    assert published_score(True, time_s, 3.0, 0.3) == pytest.approx(score)


def test_scores_of_failures_are_zero_and_none_without_a_way() -> None:
    assert (published_score(False, 10.0, 3.0, 0.3), spl(False, 3.0, 3.0)) == (0.0, 0.0)
    assert (published_score(True, 10.0, None, 0.3), spl(True, 3.0, None)) == (None, None)


def test_spl_never_exceeds_one() -> None:
    assert spl(True, 6.0, 3.0) == 0.5
    assert spl(True, 2.9, 3.0) == 1.0
    assert spl(True, 0.0, 0.0) == 1.0
    assert published_score(True, 0.1, 0.0, 0.3) == FULL_SCORE


def room(*obstacles: Polyline | Polygon, walls: bool = True) -> World:
    return World(
        name="room",
        size_m=(8.0, 6.0),
        start=Start(x_m=1.0, y_m=1.0),
        goal=GoalPose(x_m=5.0, y_m=3.0),
        obstacles=obstacles,
        walls=walls,
    )


@each("walls", [True, False])
def test_lap_round_a_closed_ring_has_round_corners(walls: bool) -> None:
    assert lap_m(room(RING, walls=walls)) == pytest.approx(8.0 + 2 * pi * GROWN_M, rel=0.005)


def test_lap_inside_a_ring_is_shorter_than_its_wall() -> None:
    caught = replace(room(RING), start=Start(x_m=5.0, y_m=3.0), goal=GoalPose(x_m=1.0, y_m=1.0))
    assert lap_m(caught) == pytest.approx(4 * (2.0 - 2 * GROWN_M), rel=0.01)


def test_islands_do_not_lengthen_the_lap() -> None:
    box = Polygon(((1.5, 3.0), (2.5, 3.0), (2.5, 4.0), (1.5, 4.0)))
    assert lap_m(room(RING, box)) == pytest.approx(lap_m(room(RING)) or 0.0, rel=1e-9)


def test_reachable_goal_has_no_lap() -> None:
    gap = Polyline(((5.2, 2.0), (6.0, 2.0), (6.0, 4.0), (4.0, 4.0), (4.0, 2.0), (4.8, 2.0)), 0.02)
    assert lap_m(room(gap)) is None
    assert lap_m(replace(room(RING), start=Start(x_m=4.0, y_m=2.0))) is None


@each("index", range(4))
def test_every_generated_unreachable_world_has_a_lap(index: int) -> None:
    assert 1.0 < (lap_m(generate("unreachable", index, 3)) or 0.0) < 200.0
