"""Starts near that of a finding."""

from dataclasses import replace
from pathlib import Path

import pytest

from plant.corpus.generate import ADVERSARIAL_MARGIN_M
from plant.model.configuration import body_of
from protocol.world import Polyline
from runtime.errors import UserError
from study.falsify.findings import MAX_SHIFT_M, MAX_TURN_RAD, Finding, near, read_finding

WORLDS = Path(__file__).parents[4] / "study" / "falsify" / "worlds"


def finding() -> Finding:
    return read_finding(WORLDS / "fixed" / "b-wedge-claim.toml")


def test_starts_differ_a_little_and_are_drawn_again_alike() -> None:
    one = finding()
    moved = list(near(one, 20))
    assert moved == list(near(one, 20))
    assert moved[:5] == list(near(one, 5))
    starts = {other.world.start for other in moved}
    assert len(starts) == 20
    for start in starts:
        assert abs(start.x_m - one.world.start.x_m) <= MAX_SHIFT_M
        assert abs(start.y_m - one.world.start.y_m) <= MAX_SHIFT_M
        assert abs(start.heading_rad - one.world.start.heading_rad) <= MAX_TURN_RAD
    assert {other.world.goal for other in moved} == {one.world.goal}
    assert [other.seed for other in moved] == [one.seed + k for k in range(20)]


def test_a_start_without_room_is_drawn_again() -> None:
    one = finding()
    start, radius_m = one.world.start, body_of(one.world).radius_m
    wall_x = start.x_m + radius_m + ADVERSARIAL_MARGIN_M + 0.005  # half of the starts are too near
    wall = Polyline(((wall_x, start.y_m - 0.1), (wall_x, start.y_m + 0.1)), 0.01)
    beside = replace(one, world=replace(one.world, obstacles=(*one.world.obstacles, wall)))
    moved = list(near(beside, 20))
    assert len(moved) == 20
    assert all(other.world.start.x_m < start.x_m + 0.001 for other in moved)


def test_a_start_in_a_wall_is_refused_with_the_way_out() -> None:
    one = finding()
    start = one.world.start
    wall = Polyline(((start.x_m, start.y_m), (start.x_m + 0.01, start.y_m)), 0.01)
    inside = replace(one, world=replace(one.world, obstacles=(wall,)))
    with pytest.raises(UserError, match="no room near its start"):
        list(near(inside, 1))
