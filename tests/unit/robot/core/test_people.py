"""People: their places and velocities, closing speeds, walkers at a flank, and evasion."""

from math import atan2, cos, hypot, inf, isfinite, nan, pi, sin

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robot.core.navigators import evasion
from robot.core.navigators import evasion as flank_walkers
from robot.core.navigators.evasion import (
    ALONG_MM,
    ASIDE,
    BEFORE_M,
    GIVE_WAY_TICKS,
    WALKER_NEAR_M,
    Evasion,
    FlankWalker,
)
from robot.core.navigators.open_headings import Sectors
from robot.core.parameters import DEFAULTS
from robot.core.perception import closing_speed as closings
from robot.core.perception import people as peoples
from robot.core.perception import sonar_ring as rings
from robot.core.perception.echoes import BRADS, CIRCLE, HALF_CIRCLE, QUARTER
from robot.core.perception.odometry import Odometry
from robot.core.perception.people import (
    BEGIN,
    BEHIND,
    BODY_M,
    MAX_LEFT,
    MAX_PEOPLE,
    PERSON_M,
    PROVEN,
    TRACKS,
    Pedestrians,
    People,
)
from robot.core.perception.sonar_ring import Ring
from robot.core.ring import BEARINGS, HALF_CONE
from robot.core.values import Pose, Scan
from tests.support.cores import Wall, ring, seen_from
from tests.support.each import each

HERE = Pose(0.0, 0.0, 0.0)
NO_ECHO: "list[float | None]" = [inf] * 8


def ranges(x_m: float, y_m: float) -> "list[float | None]":
    """Return the ranges to a person at a place, of a robot at the origin."""
    away_m, off_rad = hypot(x_m, y_m), atan2(y_m, x_m)
    beside_rad = [max(0.0, abs(bearing - off_rad) - HALF_CONE) for bearing in BEARINGS]
    return [peoples.expected_m(away_m, one, DEFAULTS.radius_m) for one in beside_rad]


def confirmed(x_m: float, y_m: float, vx_m_s: float, vy_m_s: float) -> People:
    """Return people with one that has proved to move."""
    people = People()
    peoples.confirm(people, x_m, y_m, vx_m_s, vy_m_s, 0.0, HERE)
    people.proof[0], people.left[0] = PROVEN, MAX_LEFT
    return people


def used(people: People) -> list[int]:
    return [k for k in range(MAX_PEOPLE) if people.left[k]]


def test_person_is_followed_and_its_velocity_found() -> None:
    people, x_m = confirmed(1.2, 0.1, 0.0, 0.0), 1.2
    for _ in range(80):
        x_m -= 0.1 * DEFAULTS.period_s
        peoples.update(people, ranges(x_m, 0.1), Odometry(), DEFAULTS)
    (k,) = used(people)
    assert hypot(people.x_m[k] - x_m, people.y_m[k] - 0.1) < 0.03
    assert abs(people.vx_m_s[k] + 0.1) < 0.02
    assert people.left[k] == MAX_LEFT


def test_person_walks_on_behind_the_robot_and_is_forgotten() -> None:
    people = confirmed(-0.6, 0.0, 0.05, 0.0)
    for _ in range(60):
        peoples.update(people, NO_ECHO, Odometry(), DEFAULTS)
    assert abs(people.x_m[0] + 0.45) < 1e-9
    for _ in range(MAX_LEFT - 60):
        peoples.update(people, NO_ECHO, Odometry(), DEFAULTS)
    assert used(people) == []
    assert not people.any


def test_person_in_view_without_echo_is_forgotten_sooner() -> None:
    people, behind = confirmed(0.7, 0.0, 0.0, 0.0), confirmed(-0.7, 0.0, 0.0, 0.0)
    for _ in range(30):
        peoples.update(people, NO_ECHO, Odometry(), DEFAULTS)
        peoples.update(behind, NO_ECHO, Odometry(), DEFAULTS)
    assert used(people) == []
    assert used(behind) == [0]


def test_standing_obstacle_never_proves_motion() -> None:
    people = People()
    for _ in range(BEGIN + 30):
        peoples.confirm(people, 0.8, 0.0, -0.02, 0.0, 0.02, HERE)
        peoples.update(people, ranges(0.8, 0.0), Odometry(), DEFAULTS)
        assert people.proof[0] < PROVEN
    assert used(people) in ([], [0])


def test_person_who_comes_nearer_proves_it_within_a_second() -> None:
    people, x_m = People(), 1.0
    peoples.confirm(people, x_m, 0.0, -0.1, 0.0, 0.1, HERE)
    for _ in range(20):
        x_m -= 0.1 * DEFAULTS.period_s
        peoples.update(people, ranges(x_m, 0.0), Odometry(), DEFAULTS)
    assert people.proof[0] == PROVEN


def test_slow_departure_is_no_proof() -> None:
    people, x_m = People(), 0.6
    peoples.confirm(people, x_m, 0.0, 0.05, 0.0, -0.05, HERE)
    for _ in range(20):
        x_m += 0.05 * DEFAULTS.period_s
        peoples.update(people, ranges(x_m, 0.0), Odometry(), DEFAULTS)
    assert people.proof[0] == 0


def test_full_memory_replaces_the_farthest_person() -> None:
    people = People()
    for k in range(MAX_PEOPLE + 1):
        peoples.confirm(people, 2.0 - 0.5 * k, 1.0, 0.0, 0.0, 0.0, HERE)
    assert sorted(people.x_m) == [0.0, 0.5, 1.0, 1.5]


def test_body_beside_a_cone_gives_no_echo() -> None:
    assert peoples.expected_m(1.0, 0.3, DEFAULTS.radius_m) == inf
    assert peoples.expected_m(1.0, -0.1, DEFAULTS.radius_m) == 1.0 - BODY_M - DEFAULTS.radius_m


PERIOD_S = DEFAULTS.period_s
scans = st.lists(
    st.tuples(
        st.lists(st.integers(0, 3300), min_size=8, max_size=8),
        st.integers(0, 255),
        st.floats(),
        st.floats(-pi, pi),
    ),
    max_size=30,
)


class Observer:
    """A robot that the test moves, and its tracks."""

    def __init__(self, speed_m_s: float = 0.0, yaw_rate_rad_s: float = 0.0) -> None:
        self.odometry, self.pedestrians = Odometry(), Pedestrians()
        self.odometry.speed_m_s, self.odometry.yaw_rate_rad_s = speed_m_s, yaw_rate_rad_s

    def among(
        self, person: "tuple[float, float, float, float] | None", walls: list[Wall], ticks: int
    ) -> Ring:
        """Move a person from x, y by vx, vy; return the ring after the last tick."""
        ring = Ring()
        for tick in range(ticks):
            pose, discs = self.odometry.pose, []
            if person is not None:
                t = tick * PERIOD_S
                discs = [(person[0] + t * person[2], person[1] + t * person[3], PERSON_M)]
            ring = seen_from(pose, walls, discs)
            closings.watch(self.pedestrians, ring, self.odometry, DEFAULTS)
            self.drive()
        return ring

    def drive(self) -> None:
        x_m, y_m, heading_rad = self.odometry.pose
        step_m = self.odometry.speed_m_s * PERIOD_S
        heading_rad += 0.5 * self.odometry.yaw_rate_rad_s * PERIOD_S
        x_m, y_m = x_m + step_m * cos(heading_rad), y_m + step_m * sin(heading_rad)
        heading_rad += 0.5 * self.odometry.yaw_rate_rad_s * PERIOD_S
        self.odometry.pose = Pose(x_m, y_m, heading_rad)

    def believed(self) -> list[int]:
        return [k for k in range(TRACKS) if self.pedestrians.sure[k]]


@each("bearing_rad", [-1.2, -0.6, 0.0, 0.4, 1.0])
@each("speed_m_s", [0.0, 0.3])
def test_stationary_person_has_no_speed(bearing_rad: float, speed_m_s: float) -> None:
    observer = Observer(speed_m_s)
    place = (1.1 * cos(bearing_rad), 1.1 * sin(bearing_rad), 0.0, 0.0)
    for ticks in (10, 20, 30):
        assert max(observer.among(place, [], ticks).approach_m_s) == 0.0
        assert not observer.believed()
        observer = Observer(speed_m_s)


@each("bearing_rad", [-0.9, -0.3, 0.1, 0.7])
@each("speed_m_s", [0.0, 0.1])
def test_speed_of_an_approaching_person_is_estimated(bearing_rad: float, speed_m_s: float) -> None:
    c, s = cos(bearing_rad), sin(bearing_rad)
    observer = Observer(speed_m_s)
    ring = observer.among((1.1 * c, 1.1 * s, -0.15 * c, -0.15 * s), [], 36)
    assert len(observer.believed()) == 1
    assert 0.1 < max(ring.approach_m_s) < 0.2


def test_receding_person_is_a_pedestrian_without_approach() -> None:
    observer = Observer()
    assert max(observer.among((0.8, 0.1, 0.15, 0.0), [], 40).approach_m_s) == 0.0
    (k,) = observer.believed()
    assert observer.pedestrians.approach_m_s[k] < -0.1


def test_speed_of_a_crossing_person_is_estimated() -> None:
    observer = Observer(0.1)
    observer.among((1.0, -0.5, 0.0, 0.15), [], 50)
    (k,) = observer.believed()
    assert 0.08 < observer.pedestrians.across_m_s[k] < 0.22


def test_track_continues_behind_the_robot_for_a_while() -> None:
    observer = Observer()
    observer.among((0.8, 0.5, -0.2, 0.0), [], 85)
    (k,) = observer.believed()
    observer.among(None, [], BEHIND // 2)
    assert observer.believed() == [k]
    at_rad, away_m = (
        observer.pedestrians.at_rad[k],
        observer.pedestrians.range_m[k] + 0.12 + PERSON_M,
    )
    x_m = 0.8 - 0.2 * PERIOD_S * (85 + BEHIND // 2)
    assert hypot(away_m * cos(at_rad) - x_m, away_m * sin(at_rad) - 0.5) < 0.3
    observer.among(None, [], BEHIND)
    assert not observer.believed()
    assert not observer.pedestrians.any


@each("yaw_rate_rad_s", [-0.8, 0.8])
def test_turning_on_the_spot_makes_nothing_walk(yaw_rate_rad_s: float) -> None:
    observer = Observer(0.0, yaw_rate_rad_s)
    walls: list[Wall] = [(-2.0, 0.5, 2.0, 0.5), (0.9, -2.0, 0.9, 2.0), (-2.0, -0.7, 2.0, -0.7)]
    for _ in range(12):
        assert max(observer.among(None, walls, 10).approach_m_s) == 0.0


@each("y_m", [0.2, 0.5, -0.4])
def test_a_wall_beside_the_way_walks_nowhere(y_m: float) -> None:
    observer = Observer(0.3)
    ring = observer.among(None, [(-3.0, y_m, 4.0, y_m + 0.4)], 80)
    assert max(ring.approach_m_s) == 0.0
    assert not observer.believed()


def test_another_echo_is_not_the_last_one_come_nearer() -> None:
    observer = Observer()
    observer.among((0.9, 0.0, 0.0, 0.0), [], 20)
    for _ in range(4):
        observer.among((0.7, 0.0, 0.0, 0.0), [], 1)
    assert not observer.believed()


def test_far_away_nothing_is_followed() -> None:
    observer = Observer()
    observer.among((2.5, 0.0, -0.2, 0.0), [], 20)
    assert not observer.pedestrians.any


def test_too_near_to_be_measured_it_still_walks() -> None:
    observer = Observer()
    ring = observer.among((0.72, 0.0, -0.2, 0.0), [], 40)
    assert max(ring.approach_m_s) > 0.1


@given(scans)
def test_it_is_total_and_what_walks_is_a_finite_speed(
    given_scans: list[tuple[list[int], int, float, float]],
) -> None:
    observer, ring = Observer(), Ring()
    for tick, (ranges, bits, speed_m_s, heading_rad) in enumerate(given_scans):
        rings.update(ring, Scan(tuple(ranges), (0,) * 8, bits, 0xFF), tick * 50, DEFAULTS)
        observer.odometry.speed_m_s = speed_m_s
        observer.odometry.pose = Pose(0.0, 0.0, heading_rad)
        closings.watch(observer.pedestrians, ring, observer.odometry, DEFAULTS)
        for approach_m_s, range_m in zip(ring.approach_m_s, ring.range_m, strict=True):
            assert approach_m_s >= 0.0
            assert approach_m_s == 0.0 or (range_m is not None and isfinite(approach_m_s + range_m))


def test_speed_with_nan_clears_all_tracks() -> None:
    observer = Observer()
    observer.among((1.0, 0.0, -0.15, 0.0), [], 30)
    observer.odometry.speed_m_s = nan
    observer.among(None, [], 1)
    assert not observer.pedestrians.any
    assert not observer.believed()


def test_pedestrians_keep_their_tracks_among_many_echoes() -> None:
    observer = Observer()
    observer.among((0.8, 0.0, -0.1, 0.0), [], 30)
    (k,) = observer.believed()
    posts = [(0.5 * cos(b), 0.5 * sin(b), 0.05) for b in (-1.3, -0.8, 0.8, 1.3)]
    person = (0.65, 0.0, PERSON_M)
    for _ in range(3):
        ring = seen_from(observer.odometry.pose, [], [*posts, person])
        closings.watch(observer.pedestrians, ring, observer.odometry, DEFAULTS)
    assert k in observer.believed()


def seen(range_m: float, i: int, approach_m_s: float) -> Ring:
    ring = Ring()
    ring.range_m = [inf] * 8
    ring.range_m[i], ring.approach_m_s[i] = range_m, approach_m_s
    return ring


def test_the_limit_lets_a_walker_pass_and_takes_only_speed_away() -> None:
    assert closings.limit_m_s(seen(0.5, 3, 0.0), 0.3) == 0.3
    assert closings.limit_m_s(seen(0.3, 0, 0.2), 0.3) == 0.3  # beside the robot, not ahead
    assert 0.0 < closings.limit_m_s(seen(0.5, 3, 0.05), 0.3) < 0.1
    assert closings.limit_m_s(seen(0.5, 3, 0.05), 0.01) == 0.01
    assert closings.limit_m_s(seen(0.5, 3, 0.2), 0.3) == 0.0
    assert closings.limit_m_s(seen(0.05, 7, 0.1), 0.3) == 0.0  # at the flank


FLANKS = pytest.mark.parametrize("side", [1, -1])
STEP_M = 0.01
ALONG_TICKS = int(0.001 * ALONG_MM / STEP_M) + 2


def watch(flank_walker: FlankWalker, pose: Pose, seen: Ring) -> bool:
    return flank_walkers.watch(flank_walker, seen, pose)


def beside(side: int, range_m: float = 0.5 * WALKER_NEAR_M) -> Ring:
    """Return a ring in which only the last sonar of a flank has a near echo."""
    last, before = (7, 6) if side > 0 else (0, 1)
    return ring({last: round(1000.0 * range_m), before: 2500})


def straight(ticks: int, heading_rad: float = 0.0) -> list[Pose]:
    c, s = STEP_M * cos(heading_rad), STEP_M * sin(heading_rad)
    return [Pose(k * c, k * s, heading_rad) for k in range(ticks)]


@FLANKS
@pytest.mark.parametrize("heading_rad", [0.0, 2.0, pi - 0.01])
def test_pedestrian_alongside_is_detected(side: int, heading_rad: float) -> None:
    flank_walker = FlankWalker()
    told = [watch(flank_walker, pose, beside(side)) for pose in straight(ALONG_TICKS, heading_rad)]
    assert sum(told) == 1
    assert flank_walker.ticks == GIVE_WAY_TICKS
    turned = (flank_walker.heading - int(BRADS * heading_rad) + HALF_CIRCLE) % CIRCLE - HALF_CIRCLE
    assert turned == -side * ASIDE


@FLANKS
def test_passed_end_of_a_wall_is_no_pedestrian(side: int) -> None:
    wall: list[Wall] = [(-3.0, side * 0.25, 0.0, side * 0.25)]
    flank_walker = FlankWalker()
    for k in range(200):
        pose = Pose(-1.0 + STEP_M * k, 0.0, 0.0)
        assert not watch(flank_walker, pose, seen_from(pose, wall))


@FLANKS
def test_passed_post_is_no_pedestrian(side: int) -> None:
    flank_walker = FlankWalker()
    for k in range(200):
        pose = Pose(-1.0 + STEP_M * k, 0.0, 0.0)
        assert not watch(flank_walker, pose, seen_from(pose, [], [(0.0, side * 0.25, 0.05)]))


@FLANKS
def test_disc_that_keeps_up_is_a_pedestrian(side: int) -> None:
    flank_walker = FlankWalker()
    told = []
    for pose in straight(ALONG_TICKS):
        person = (pose.x_m - 0.04, side * 0.30, 0.10)
        told.append(watch(flank_walker, pose, seen_from(pose, [], [person])))
    assert any(told)


def test_continuing_wall_is_no_pedestrian() -> None:
    flank_walker = FlankWalker()
    wall: list[Wall] = [(-3.0, -0.25, 3.0, -0.25)]
    assert not any(watch(flank_walker, pose, seen_from(pose, wall)) for pose in straight(100))


@FLANKS
def test_pillar_circled_on_an_arc_is_no_pedestrian(side: int) -> None:
    """Circle a static obstacle, which stays beside the robot."""
    flank_walker, radius_m = FlankWalker(), 0.3
    for k in range(400):
        angle_rad = side * k * STEP_M / radius_m
        pose = Pose(radius_m * sin(angle_rad), -side * radius_m * cos(angle_rad), angle_rad)
        assert not watch(flank_walker, pose, beside(side))


@FLANKS
def test_change_of_flank_restarts_the_measurement(side: int) -> None:
    flank_walker = FlankWalker()
    half = ALONG_TICKS * 2 // 3
    told = [
        watch(flank_walker, pose, beside(side if k < half else -side))
        for k, pose in enumerate(straight(2 * half))
    ]
    assert not any(told)


def test_stationary_robot_detects_no_pedestrian() -> None:
    flank_walker = FlankWalker()
    assert not any(watch(flank_walker, Pose(1.0, 1.0, 0.5), beside(1)) for _ in range(500))


@FLANKS
def test_flank_is_where_only_the_last_sonar_has_an_echo(side: int) -> None:
    last, before = (7, 6) if side > 0 else (0, 1)
    near_mm, far_mm = round(500.0 * WALKER_NEAR_M), round(1000.0 * (WALKER_NEAR_M + BEFORE_M))
    assert flank_walkers.flank(ring({last: near_mm, before: near_mm + far_mm})) == side
    assert flank_walkers.flank(ring({last: near_mm})) == side
    assert flank_walkers.flank(ring({last: near_mm, before: near_mm + 50})) == 0
    assert flank_walkers.flank(ring({last: far_mm})) == 0
    assert flank_walkers.flank(ring({})) == 0


@FLANKS
@pytest.mark.parametrize("silent", [0, 1])
def test_flank_with_a_missing_sonar_does_not_count(side: int, silent: int) -> None:
    seen = beside(side)
    seen.range_m[(7 - silent) if side > 0 else silent] = None
    assert flank_walkers.flank(seen) == 0


places, speeds = st.floats(-1.5, 1.5), st.floats(-0.4, 0.4)


def people_of(*each: tuple[float, float, float, float]) -> People:
    """Return proven people: x_m, y_m and velocity of each."""
    people = People()
    for k, (x_m, y_m, vx_m_s, vy_m_s) in enumerate(each):
        people.x_m[k], people.y_m[k] = x_m, y_m
        people.vx_m_s[k], people.vy_m_s[k] = vx_m_s, vy_m_s
        people.left[k], people.proof[k] = MAX_LEFT, PROVEN
        people.any = True
    return people


def chosen(people: People, wanted: int = 0, e: "Evasion | None" = None) -> int:
    return evasion.choose(e or Evasion(), people, Sectors(), wanted, HERE, DEFAULTS)


def least_gap_m(person: tuple[float, float, float, float], heading: int) -> float:
    """Return the gap of the closest approach in 3 s, turning on the spot at 2.2 rad/s first."""
    x_m, y_m, vx_m_s, vy_m_s = person
    turn_s, gaps = abs(heading) / BRADS / 2.2, []
    for tick in range(10, 61):
        way_m = 0.3 * max(0.0, 0.05 * tick - turn_s)
        dx_m = x_m + 0.05 * tick * vx_m_s - way_m * cos(heading / BRADS)
        dy_m = y_m + 0.05 * tick * vy_m_s - way_m * sin(heading / BRADS)
        gaps.append(hypot(dx_m, dy_m) - 0.32)
    return min(gaps)


def test_heading_is_kept_without_people() -> None:
    assert chosen(People(), 700) == 700


@each(
    "person",
    [(-0.6, 0.0, 0.1, 0.0), (0.8, 0.6, 0.1, 0.1), (0.0, 1.0, 0.0, -0.05), (2.0, 0.0, -0.2, 0.0)],
)
def test_heading_is_kept_if_the_person_stays_away(
    person: tuple[float, float, float, float],
) -> None:
    e = Evasion()
    assert chosen(people_of(person), 0, e) == 0
    assert (e.active, e.most_m_s) == (False, inf)


@each(
    "person",
    [(1.1, 0.1, -0.15, 0.0), (0.9, 0.5, 0.0, -0.15), (0.4, -0.5, 0.05, 0.15)],
)
def test_robot_leaves_the_line_of_a_person(person: tuple[float, float, float, float]) -> None:
    e = Evasion()
    heading = chosen(people_of(person), 0, e)
    assert e.active
    if e.most_m_s == inf:
        assert least_gap_m(person, heading) > least_gap_m(person, 0)


def test_person_that_has_not_proved_to_move_is_ignored() -> None:
    people = people_of((1.1, 0.1, -0.15, 0.0))
    people.proof[0] = PROVEN - 1
    assert chosen(people) == 0


def test_choice_is_kept_while_it_is_as_good() -> None:
    e, people = Evasion(), people_of((1.0, 0.0, -0.15, 0.0))
    first = chosen(people, 0, e)
    assert first != 0
    people.y_m[0] = 0.01 if first > 0 else -0.01
    assert chosen(people, 0, e) == first


def test_closed_headings_are_avoided() -> None:
    people, sectors = people_of((1.0, 0.02, -0.15, 0.0)), Sectors()
    free = chosen(people)
    sectors.count, sectors.point[0], sectors.away_mm[0] = 1, 0, 200
    sectors.bearing[0], sectors.tight[0] = free, QUARTER // 2
    other = evasion.choose(Evasion(), people, sectors, 0, HERE, DEFAULTS)
    assert abs(other - free) >= QUARTER // 2


def test_robot_waits_where_no_other_way_is_open() -> None:
    e, sectors = Evasion(), Sectors()
    sectors.count, sectors.point[0], sectors.away_mm[0] = 1, 0, 200
    sectors.bearing[0], sectors.tight[0] = HALF_CIRCLE, HALF_CIRCLE - 100
    people = people_of((0.75, 0.6, 0.0, -0.2))
    assert evasion.choose(e, people, sectors, 0, HERE, DEFAULTS) == 0
    assert e.active
    assert e.most_m_s == 0.0


@given(
    st.lists(st.tuples(places, places, speeds, speeds), min_size=1, max_size=MAX_PEOPLE),
    st.integers(-HALF_CIRCLE, HALF_CIRCLE),
    st.floats(0.0, 4.0),
    st.floats(0.0, 12.0),
)
def test_risk_that_ends_early_is_high_enough(
    persons: list[tuple[float, float, float, float]], heading: int, cost: float, least: float
) -> None:
    people, near = people_of(*persons), (1 << len(persons)) - 1
    speed_m_s = DEFAULTS.v_max_m_s
    whole = evasion.risk(people, near, heading, HERE, speed_m_s, DEFAULTS)
    found = evasion.risk(people, near, heading, HERE, speed_m_s, DEFAULTS, cost, least)
    assert found <= whole
    assert found == whole or cost + evasion.PASS_COST * found >= least
