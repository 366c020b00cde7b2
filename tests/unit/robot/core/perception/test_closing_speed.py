from math import cos, hypot, inf, isfinite, nan, pi, sin

from hypothesis import given
from hypothesis import strategies as st

from robot.core.parameters import DEFAULTS
from robot.core.perception import closing_speed as closings
from robot.core.perception import sonar_ring as rings
from robot.core.perception.odometry import Odometry
from robot.core.perception.people import BEHIND, PERSON_M, TRACKS, Pedestrians
from robot.core.perception.sonar_ring import Ring
from robot.core.values import Pose, Scan
from tests.support.each import each
from tests.support.robot.core.rings import Wall, seen_from

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
