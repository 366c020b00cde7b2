"""Rays and sonars."""

from collections.abc import Sequence
from itertools import pairwise
from math import asin, cos, degrees, hypot, inf, pi, radians, sin, sqrt

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from plant.model.configuration import LEVELS, Body, Fault, Noise
from plant.model.geometry import Pose, StaticScene, clearance_m, still
from plant.sim.active_faults import FaultSchedule, SonarFaults
from plant.sim.sonar import (
    ORDER,
    PING_AGE_US,
    RAYS_PER_SONAR,
    Caster,
    SimulatedSonarRing,
    SonarReading,
    ray_bearings_rad,
)
from protocol.ring import SONARS
from protocol.world import Obstacle, Polyline, WorldCircle, WorldPolygon
from tests.support.each import each
from tests.support.plant import room

RIM_M = 0.12
ALL = 0b1111_1111
NONE = LEVELS["none"]
SCANS = 4000


def nearness(ranges_m: Sequence[float | None]) -> list[float]:
    """Return the input of the sonar model for one range per sonar."""
    in_order = [ranges_m[sonar] for sonar in ORDER]
    return [0.0 if range_m is None else 1.0 / (range_m + RIM_M) for range_m in in_order]


def ring(noise: Noise = NONE, seed: int = 1) -> SimulatedSonarRing:
    return SimulatedSonarRing(Body(), noise, seed, 0)


def trouble(*faults: Fault) -> SonarFaults:
    found = FaultSchedule(faults).at(0).sonar
    assert found is not None
    return found


def many(noise: Noise, range_m: float | None) -> list[SonarReading]:
    one = ring(noise)
    return [one.read(nearness([range_m] * 8), None) for _ in range(SCANS)]


def echoes_mm(readings: list[SonarReading]) -> list[int]:
    return [reading.range_mm[i] for reading in readings for i in range(8) if reading.echo >> i & 1]


def test_ranges_are_from_the_rim_in_sonar_order() -> None:
    reading = ring().read(nearness([0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8]), None)
    assert reading == SonarReading((100, 200, 300, 400, 500, 600, 700, 800), ALL, ALL)


def test_even_sonars_were_pinged_half_a_period_before_the_stamp() -> None:
    assert PING_AGE_US == (25_000, 0, 25_000, 0, 25_000, 0, 25_000, 0)


def test_missing_echo_still_counts_as_a_measurement() -> None:
    reading = ring().read(nearness([None, 1.0, 3.0001, 2.9999, 1.0, 1.0, 1.0, 1.0]), None)
    assert (reading.valid, reading.echo) == (ALL, 0b1111_1010)
    assert reading.range_mm[:4] == (0, 1000, 0, 3000)


def test_ranges_below_the_minimum_read_the_minimum() -> None:
    assert ring().read(nearness([0.0, 0.019, -0.001, 0.021] * 2), None).range_mm[:4] == (
        20,
        20,
        20,
        21,
    )


@each(("level", "range_m"), [("default", 0.5), ("default", 2.5), ("harsh", 1.0)])
def test_range_noise_is_gaussian_with_the_configured_sigma(level: str, range_m: float) -> None:
    noise = LEVELS[level]
    sigma_mm = 1e3 * (noise.range_sigma_m + noise.range_sigma_ratio * range_m)
    errors = np.array(echoes_mm(many(noise, range_m))) - range_m * 1e3
    near = errors[abs(errors) < 5.0 * sigma_mm]  # ghosts aside
    assert near.std() == pytest.approx(sigma_mm, rel=0.03)
    assert abs(near.mean()) < 0.05 * sigma_mm
    assert (abs(near) < 2.0 * sigma_mm).mean() == pytest.approx(0.954, abs=0.015)


@each("level", ["default", "harsh"])
def test_echo_dropout_rate_matches_the_configuration(level: str) -> None:
    readings = many(LEVELS[level], 1.0)
    lost = 1.0 - len(echoes_mm(readings)) / (8 * SCANS)
    assert lost == pytest.approx(LEVELS[level].dropout_probability, rel=0.2)
    assert {reading.valid for reading in readings} == {ALL}


def test_false_echoes_are_nearer_and_have_the_configured_rate() -> None:
    ghosts = echoes_mm(many(Noise(ghost_probability=0.01), None))
    assert len(ghosts) / (8 * SCANS) == pytest.approx(0.01, rel=0.2)
    assert (min(ghosts) >= 20, max(ghosts) <= 3000) == (True, True)
    assert np.mean(ghosts) == pytest.approx(1510, rel=0.1)
    short = [mm for mm in echoes_mm(many(Noise(ghost_probability=0.01), 0.5)) if mm != 500]
    assert 0.005 < len(short) / (8 * SCANS) < 0.015
    assert max(short) < 500


def test_readings_depend_only_on_the_seed() -> None:
    def read(seed: int) -> SonarReading:
        return ring(LEVELS["default"], seed).read(nearness([2.0] * 8), None)

    assert read(1) == read(1)
    assert read(1) != read(2)


@given(st.lists(st.one_of(st.none(), st.floats(-0.119, 5.0)), min_size=8, max_size=8))
def test_every_reading_fits_its_wire_field(ranges_m: list[float | None]) -> None:
    noise = Noise(range_sigma_m=1.0, range_sigma_ratio=1.0, ghost_probability=0.3)
    reading = ring(noise).read(nearness(ranges_m), None)
    for sonar in range(8):
        echo = reading.echo >> sonar & 1
        assert reading.range_mm[sonar] == 0 or echo
        assert not echo or 20 <= reading.range_mm[sonar] <= 3000


def test_dead_sonar_does_not_measure() -> None:
    reading = ring().read(nearness([1.0] * 8), trouble(Fault("sonar_dead", "2")))
    assert (reading.valid, reading.echo, reading.range_mm[2]) == (0b1111_1011, 0b1111_1011, 0)


def test_frozen_sonar_repeats_its_last_reading() -> None:
    one, frozen = ring(), trouble(Fault("sonar_frozen", "2"), Fault("sonar_frozen", "5"))
    one.read(nearness([1.0, 1.0, 1.0, 1.0, 1.0, None, 1.0, 1.0]), None)
    for range_m in (0.9, 0.8):
        reading = one.read(nearness([range_m] * 8), frozen)
        assert (reading.range_mm[2], reading.range_mm[3]) == (1000, round(range_m * 1e3))
        assert reading.echo == 0b1101_1111
    assert one.read(nearness([0.7] * 8), None).range_mm[2] == 700


def test_sonar_with_fixed_value_ignores_the_echo() -> None:
    fixed = trouble(Fault("sonar_fixed", "0", value=0.4), Fault("sonar_fixed", "1", value=12.5))
    reading = ring().read(nearness([1.0] + [None] * 7), fixed)
    assert (reading.range_mm[:2], reading.echo) == ((400, 12500), 0b11)


def test_sonar_with_an_offset_reads_too_far_or_too_near() -> None:
    off = trouble(Fault("sonar_offset", "0", value=0.2), Fault("sonar_offset", "1", value=-2.0))
    reading = ring().read(nearness([1.0] * 2 + [None] * 6), off)
    assert (reading.range_mm[:3], reading.echo) == ((1200, 0, 0), 0b11)


def test_ring_without_any_echo_still_measures() -> None:
    lost = trouble(Fault("sonar_dropout", "all", value=1.0))
    assert ring().read(nearness([1.0] * 8), lost) == SonarReading((0,) * 8, ALL, 0)


def test_weak_sonar_loses_the_configured_share_of_echoes() -> None:
    one, weak = ring(), trouble(Fault("sonar_dropout", "3", value=0.25))
    read = [one.read(nearness([1.0] * 8), weak).echo for _ in range(2000)]
    assert sum(not echo >> 3 & 1 for echo in read) / 2000 == pytest.approx(0.25, rel=0.15)
    assert all(echo | 0b1000 == ALL for echo in read)


NOTHING = StaticScene((), ())
AHEAD_RIGHT, AHEAD_LEFT = 3, 4
ROUNDED_M = 2e-5
"""Places are rounded to 8 micrometres, directions to 15 nanoradians."""
INNERMOST_RAD = radians(2.25)
OUTERMOST_RAD = radians(87.75)


def seen_m(caster: Caster, pose: Pose, late: Pose | None = None) -> list[float]:
    """Return the distance from the centre for each sonar, from right to left; inf: no echo."""
    return in_turn(caster.cast(pose, late or pose))


def in_turn(nearness: list[float]) -> list[float]:
    by_sonar = dict(zip(ORDER, nearness, strict=True))
    return [1.0 / by_sonar[i] if by_sonar[i] > 0.0 else inf for i in range(SONARS)]


def marched_m(obstacles: tuple[Obstacle, ...], pose: Pose, bearing_rad: float) -> float:
    """Return the length of a ray by marching in steps that cannot meet an obstacle."""
    gone_m, towards_rad = 0.0, pose[2] + bearing_rad
    for _ in range(3000):
        at = (pose[0] + gone_m * cos(towards_rad), pose[1] + gone_m * sin(towards_rad))
        free_m = min((clearance_m(at, obstacle) for obstacle in obstacles), default=inf)
        if free_m < 1e-9 or gone_m > 20.0:
            break
        gone_m += free_m
    return gone_m if gone_m <= 20.0 else inf


def cone_rays_rad(sonar: int) -> tuple[float, ...]:
    column = ORDER.index(sonar) * RAYS_PER_SONAR
    return ray_bearings_rad()[column : column + RAYS_PER_SONAR]


def test_cones_cover_a_half_turn_with_evenly_spaced_rays() -> None:
    bearings = sorted(degrees(bearing) for bearing in ray_bearings_rad())
    gaps = [b - a for a, b in pairwise(bearings)]
    assert gaps == pytest.approx([4.5] * 39)
    assert (bearings[0] - 2.25, bearings[-1] + 2.25) == pytest.approx((-90.0, 90.0))
    for sonar in range(SONARS):
        offsets = [degrees(ray) - (sonar - 3.5) * 22.5 for ray in cone_rays_rad(sonar)]
        assert offsets == pytest.approx([-9.0, -4.5, 0.0, 4.5, 9.0])


def test_empty_space_gives_no_echo() -> None:
    assert seen_m(Caster(NOTHING, 3.0, pi / 2), (0.0, 0.0, 0.0)) == [inf] * 8


def test_ranges_to_room_walls_match_geometry() -> None:
    seen = seen_m(Caster(still(room()), 10.0, pi / 2), (1.0, 2.0, 0.0))
    assert seen[AHEAD_LEFT] == pytest.approx(3.0 / cos(INNERMOST_RAD), abs=ROUNDED_M)
    assert [seen[0], seen[7]] == pytest.approx([2.0 / sin(OUTERMOST_RAD)] * 2, abs=ROUNDED_M)


def test_range_to_a_disc_on_the_ray_is_to_its_rim() -> None:
    heading_rad = -radians(2.25)  # one ray of the cone ahead to the left looks along x
    seen = seen_m(
        Caster(StaticScene(((2.0, 0.0, 0.5),), ()), 10.0, pi / 2), (0.0, 0.0, heading_rad)
    )
    assert seen[AHEAD_LEFT] == pytest.approx(1.5, abs=ROUNDED_M)


def test_ray_beside_the_centre_meets_the_flank_of_a_disc() -> None:
    scene = StaticScene(((2.0, 0.0, 0.5),), ())
    seen = seen_m(Caster(scene, 10.0, pi / 2), (0.0, 0.0, 0.0))
    away_m = 2.0 * cos(INNERMOST_RAD) - sqrt(0.25 - (2.0 * sin(INNERMOST_RAD)) ** 2)
    assert seen[AHEAD_LEFT] == seen[AHEAD_RIGHT] == pytest.approx(away_m, abs=ROUNDED_M)
    widest_rad = asin(0.5 / 2.0)
    visible = [any(abs(ray) < widest_rad for ray in cone_rays_rad(i)) for i in range(SONARS)]
    assert [away < inf for away in seen] == visible


def test_shapes_behind_the_origin_are_not_seen() -> None:
    behind = still(room(WorldCircle(x_m=0.4, y_m=2.0, radius_m=0.2), walls=False))
    assert seen_m(Caster(behind, 10.0, pi / 2), (1.0, 2.0, 0.0)) == [inf] * 8
    box = WorldPolygon(((0.2, 1.5), (0.6, 1.5), (0.6, 2.5), (0.2, 2.5)))
    assert seen_m(Caster(still(room(box, walls=False)), 10.0, pi / 2), (1.0, 2.0, 0.0)) == [inf] * 8


def test_round_end_of_a_wall_is_seen() -> None:
    wall = still(room(Polyline(((2.0, 2.0), (3.0, 2.0)), 0.2), walls=False))
    seen = seen_m(Caster(wall, 10.0, pi / 2), (1.0, 2.0, -radians(2.25)))
    assert seen[AHEAD_LEFT] == pytest.approx(0.9, abs=ROUNDED_M)


def test_edge_on_wall_is_not_seen_from_its_hidden_side() -> None:
    box = WorldPolygon(((2.0, 2.0), (3.0, 2.0), (3.0, 3.0), (2.0, 3.0)))
    seen = seen_m(Caster(still(room(box, walls=False)), 10.0, pi / 2), (1.0, 2.0, 0.0))
    assert seen[AHEAD_LEFT] == pytest.approx(1.0 / cos(INNERMOST_RAD), abs=ROUNDED_M)
    assert seen[AHEAD_RIGHT] == inf


U_SHAPE = WorldPolygon(
    ((2.0, 1.0), (3.0, 1.0), (3.0, 3.0), (2.0, 3.0), (2.0, 2.8), (2.8, 2.8), (2.8, 1.2), (2.0, 1.2))
)


def test_inside_of_a_concave_polygon_is_seen() -> None:
    seen = seen_m(Caster(still(room(U_SHAPE, walls=False)), 10.0, pi / 2), (1.0, 2.0, 0.0))
    assert seen[AHEAD_LEFT] == pytest.approx(1.8 / cos(INNERMOST_RAD), abs=ROUNDED_M)


OBSTACLES: tuple[Obstacle, ...] = (
    U_SHAPE,
    Polyline(((0.5, 0.5), (1.0, 1.0), (1.8, 0.4)), 0.06),
    WorldCircle(x_m=0.8, y_m=3.2, radius_m=0.3),
    WorldCircle(x_m=3.6, y_m=0.5, radius_m=0.1),
    WorldPolygon(((3.4, 3.3), (3.9, 3.2), (3.7, 3.8))),
)


@settings(max_examples=40, deadline=None)
@given(st.floats(0.0, 4.0), st.floats(0.0, 4.0), st.floats(-pi, pi))
def test_cone_ranges_match_sphere_tracing(x_m: float, y_m: float, heading_rad: float) -> None:
    if min(clearance_m((x_m, y_m), obstacle) for obstacle in OBSTACLES) < 0.12:
        return
    pose = (x_m, y_m, heading_rad)
    seen = seen_m(Caster(still(room(*OBSTACLES, walls=False)), 30.0, pi / 2), pose)
    for sonar in range(SONARS):
        # A ray that grazes a surface may pass it instead.
        bundles_m = [
            [marched_m(OBSTACLES, pose, ray + off_rad) for off_rad in (-ROUNDED_M, 0.0, ROUNDED_M)]
            for ray in cone_rays_rad(sonar)
        ]
        assert seen[sonar] >= min(map(min, bundles_m)) - ROUNDED_M
        assert seen[sonar] <= min(map(max, bundles_m)) + ROUNDED_M


POSES = st.tuples(st.floats(0.0, 4.0), st.floats(0.0, 4.0), st.floats(-pi, pi))
STEPS = st.tuples(st.floats(-0.06, 0.06), st.floats(-0.06, 0.06), st.floats(-0.4, 0.4))


@pytest.mark.parametrize("limit_rad", [pi / 2, radians(40.0)])
@given(POSES, st.lists(STEPS, min_size=1, max_size=12))
def test_selected_surfaces_are_enough_until_the_next_selection(
    limit_rad: float, pose: Pose, steps: list[Pose]
) -> None:
    scene = still(room(*OBSTACLES))
    moving = Caster(scene, 3.12, limit_rad)
    for x_m, y_m, turn_rad in steps:
        before, pose = pose, (pose[0] + x_m, pose[1] + y_m, pose[2] + turn_rad)
        expected = Caster(scene, 3.12, limit_rad).cast(before, pose)
        for near, wanted in zip(moving.cast(before, pose), expected, strict=True):
            assert near == wanted or max(near, wanted) < 1.0 / 3.12


@given(st.floats(0.1, 9.9), st.floats(0.1, 9.9), st.floats(-pi, pi))
def test_no_ray_slips_between_the_walls_of_a_closed_room(
    x_m: float, y_m: float, heading_rad: float
) -> None:
    closed = Caster(still(room(size_m=(10.0, 10.0))), 20.0, pi / 2)
    farthest_m = hypot(10.0, 10.0)
    assert max(seen_m(closed, (x_m, y_m, heading_rad))) <= farthest_m


@given(st.floats(-80.0, 80.0), st.floats(5.0, 85.0))
def test_wall_returns_an_echo_only_at_steep_incidence(bearing_deg: float, limit_deg: float) -> None:
    caster = Caster(StaticScene((), (_facing(bearing_deg),)), 30.0, radians(limit_deg))
    seen = seen_m(caster, (0.0, 0.0, 0.0))
    for sonar in range(SONARS):
        steepest_rad = min(abs(ray - radians(bearing_deg)) for ray in cone_rays_rad(sonar))
        if abs(steepest_rad - radians(limit_deg)) > 1e-6:
            met = steepest_rad < radians(limit_deg)
            wanted_m = 1.0 / cos(steepest_rad) if met else inf
            assert seen[sonar] == pytest.approx(wanted_m, abs=30.0 * ROUNDED_M)


def _facing(bearing_deg: float) -> tuple[float, float, float, float]:
    """Return a long wall, 1 m from the origin in this direction and perpendicular to it."""
    across_x, across_y = sin(radians(bearing_deg)), -cos(radians(bearing_deg))
    foot_x, foot_y = cos(radians(bearing_deg)), sin(radians(bearing_deg))
    far = 20.0
    return (
        foot_x - far * across_x,
        foot_y - far * across_y,
        foot_x + far * across_x,
        foot_y + far * across_y,
    )


def test_disc_returns_an_echo_only_at_steep_incidence() -> None:
    disc = StaticScene(((1.0, 0.0, 0.3),), ())
    aside_rad = asin(0.3 * sin(radians(45.0)))  # this ray meets the disc at 45 degrees
    for limit_deg, met in ((44.0, False), (46.0, True)):
        heading_rad = -cone_rays_rad(7)[-1] - aside_rad  # only the last ray of all looks there
        seen = seen_m(Caster(disc, 9.0, radians(limit_deg)), (0.0, 0.0, heading_rad))
        assert (seen[7] < inf) == met


def test_grazed_wall_still_hides_shapes_behind_it() -> None:
    hidden = StaticScene(((3.0, 0.0, 0.5),), (_facing(60.0),))
    seen = seen_m(Caster(hidden, 9.0, radians(20.0)), (0.0, 0.0, 0.0))
    assert seen[AHEAD_LEFT] == seen[AHEAD_RIGHT] == inf


def test_early_sonars_measure_from_the_earlier_pose() -> None:
    caster = Caster(still(room()), 10.0, pi / 2)
    early, late = (1.0, 2.0, 0.2), (1.1, 2.05, 0.3)
    both, from_early = in_turn(caster.cast(early, late)), seen_m(caster, early)
    from_late = seen_m(caster, late)
    for sonar in range(SONARS):
        wanted = from_late if sonar % 2 else from_early
        assert both[sonar] == pytest.approx(wanted[sonar], abs=ROUNDED_M)


def test_moving_disc_is_seen_at_its_position_of_each_ping() -> None:
    caster = Caster(NOTHING, 10.0, pi / 2)
    here = (0.0, 0.0, 0.0)
    seen = in_turn(caster.cast(here, here, ([(2.0, 0.0, 0.5)], [(2.2, 0.0, 0.5)])))
    for sonar, at_m in ((AHEAD_LEFT, 2.0), (AHEAD_RIGHT, 2.2)):
        still_one = Caster(StaticScene(((at_m, 0.0, 0.5),), ()), 10.0, pi / 2)
        assert seen[sonar] == pytest.approx(seen_m(still_one, here)[sonar], abs=ROUNDED_M)
    assert seen_m(caster, here) == [inf] * 8


def test_grazed_moving_disc_gives_no_echo() -> None:
    caster = Caster(NOTHING, 10.0, radians(1.0))
    here, disc = (0.0, 0.0, 0.0), [(2.0, 0.0, 0.5)]
    assert in_turn(caster.cast(here, here, (disc, disc))) == [inf] * 8


@settings(max_examples=20, deadline=None)
@given(
    st.lists(
        st.tuples(st.floats(0.2, 29.8), st.floats(0.2, 3.8), st.floats(-pi, pi)),
        min_size=1,
        max_size=40,
    )
)
def test_only_shapes_behind_or_out_of_range_are_skipped(poses: list[Pose]) -> None:
    """Compare a caster that moves with a new caster at each pose."""
    discs = tuple((0.5 * i, 2.0 + (-1.0) ** i, 0.2) for i in range(60))
    scene = StaticScene(discs, still(room(size_m=(30.0, 4.0))).edges)
    travelling = Caster(scene, 3.12, pi / 2)
    for pose in poses:
        x_m, y_m, _ = pose
        if min(hypot(x_m - x, y_m - y) - r for x, y, r in discs) < 0.1:
            continue
        everything = Caster(scene, 60.0, pi / 2)
        for seen, wanted in zip(seen_m(travelling, pose), seen_m(everything, pose), strict=True):
            assert seen == pytest.approx(wanted, abs=1e-9) or min(seen, wanted) > 3.12


@settings(max_examples=20, deadline=None)
@given(st.lists(st.tuples(st.floats(-0.2, 0.2), st.floats(-0.4, 0.4)), min_size=1, max_size=60))
def test_slow_turn_and_short_motion_hide_no_shape(steps: list[tuple[float, float]]) -> None:
    """Steps this small mostly reuse the selection of shapes."""
    discs = tuple((2.0 + 0.6 * i, 2.0 + 0.6 * j, 0.1) for i in range(-4, 5) for j in range(-4, 5))
    scene = StaticScene(discs, still(room(size_m=(4.0, 4.0))).edges)
    travelling = Caster(scene, 3.12, pi / 2)
    along_m, heading_rad = 0.0, 0.0
    for way_m, turn_rad in steps:
        along_m, heading_rad = abs((along_m + way_m) % 0.6 - 0.3), heading_rad + turn_rad
        pose = (1.7, 1.7 + along_m, heading_rad)
        anew = Caster(scene, 3.12, pi / 2)
        assert seen_m(travelling, pose) == seen_m(anew, pose)
