"""Telemetry as messages of ROS 2: covariances, frames, ranges, wheels, the description, stamps."""

from math import hypot, inf, isclose, isnan, nan, pi
from types import SimpleNamespace
from xml.etree import ElementTree

import pytest
from hypothesis import given
from hypothesis import strategies as st

from checks.harness.messages import make
from gateways.ros2.interfaces import Interfaces
from gateways.ros2.wire import Distro
from ground.ros2 import markers, messages
from ground.ros2.messages import Geometry, RosClock, WheelReader
from ground.ros2.robot_topics import RobotTopics
from protocol.ring import BEARINGS_RAD
from protocol.ros_bag import yaw_of
from protocol.wire.enums import Branch, GoalState
from protocol.wire.messages import (
    AvoidanceDecision,
    NavigatorStatus,
    PlanarOdometry,
    SonarScan,
    SystemTime,
    WheelTicks,
)
from runtime.units import NS_PER_S

HERE = make(
    PlanarOdometry,
    time_ns=5 * NS_PER_S + 7,
    x_m=1.25,
    y_m=-2.5,
    heading_rad=pi / 2,
    speed_m_s=0.3,
    yaw_rate_rad_s=-0.5,
    cov_xx_m2=1.0,
    cov_xy_m2=2.0,
    cov_xh_m_rad=3.0,
    cov_yy_m2=4.0,
    cov_yh_m_rad=5.0,
    cov_hh_rad2=6.0,
)
SIZE = Geometry(radius_m=0.2, track_m=0.3, wheel_radius_m=0.05, m_per_tick=0.001, sonar_max_m=4.0)


def test_odometry_has_the_values_and_the_stamp_of_the_robot() -> None:
    found = messages.odometry(HERE, HERE.time_ns)
    assert (found.header.stamp.sec, found.header.stamp.nanosec) == (5, 7)
    position = found.pose.pose.position
    assert (position.x, position.y, position.z) == (1.25, -2.5, 0.0)
    assert (found.twist.twist.linear.x, found.twist.twist.angular.z) == (0.3, -0.5)
    assert yaw_of(found.pose.pose.orientation) == pytest.approx(pi / 2)


def test_covariance_has_x_y_and_yaw_and_large_other_axes() -> None:
    rows = messages.pose_covariance(HERE).reshape(6, 6)
    assert (rows == rows.T).all()
    assert [rows[i, j] for i, j in ((0, 0), (0, 1), (0, 5), (1, 1), (1, 5), (5, 5))] == [
        *(1.0, 2.0, 3.0, 4.0, 5.0, 6.0)
    ]
    assert [rows[axis, axis] for axis in (2, 3, 4)] == [1e6] * 3


def test_unknown_place_has_a_large_covariance_without_nan() -> None:
    lost = make(PlanarOdometry, cov_xx_m2=nan, cov_yy_m2=nan)
    rows = messages.pose_covariance(lost).reshape(6, 6)
    assert [rows[axis, axis] for axis in range(6)] == [1e6] * 6


@given(st.floats(-100.0, 100.0))
def test_rotation_is_normalised_and_read_back(heading_rad: float) -> None:
    rotation = messages.yawed(heading_rad)
    assert isclose(hypot(rotation.x, rotation.y, rotation.z, rotation.w), 1.0)
    yaw_rad = yaw_of(rotation)
    assert yaw_rad is not None
    assert abs((yaw_rad - heading_rad + pi) % (2 * pi) - pi) < 1e-6


def test_rotation_that_is_none_has_no_yaw() -> None:
    for values in ((0.0, 0.0, 0.0, 0.0), (nan, 0.0, 0.0, 1.0), (0.0, 0.0, inf, 1.0)):
        assert yaw_of(SimpleNamespace(**dict(zip("xyzw", values, strict=True)))) is None


def test_sonar_without_an_echo_is_infinite_and_one_that_slept_is_missing() -> None:
    ages_us = (0, 10, 20, 30, 40, 50, 60, 70)
    scan = make(SonarScan, range_mm=(500,) * 8, ping_age_us=ages_us, valid=0b0111, echo=0b0101)
    found = messages.ranges(scan, SIZE, 1_000_000)
    assert [(sonar, one.range) for sonar, one in found] == [(0, 0.5), (1, inf), (2, 0.5)]
    assert [one.header.stamp.nanosec for _, one in found] == [1_000_000, 990_000, 980_000]
    assert found[0][1].max_range == 4.0
    distances = messages.laser_scan(scan, SIZE, 0).ranges
    assert [distances[0], distances[1]] == [pytest.approx(0.7), inf]
    assert isnan(distances[3])


def test_wheel_speeds_integrate_to_angles_also_where_counters_wrap() -> None:
    reader, top = WheelReader(), 2**31 - 5
    reader.read(make(WheelTicks, time_ns=0, left=top, right=0), SIZE, 0)
    angle_rad = 0.0
    for period in range(1, 4):
        left = (top + 10 * period + 2**31) % 2**32 - 2**31
        ticks = make(WheelTicks, time_ns=period * NS_PER_S // 20, left=left, right=-period)
        state = reader.read(ticks, SIZE, 0)
        angle_rad += state.speeds_rad_s[0] / 20
    assert state.angles_rad == pytest.approx((30 * 0.001 / 0.05, -3 * 0.02))
    assert angle_rad == pytest.approx(state.angles_rad[0])


def test_links_of_the_description_are_the_frames_of_the_tree() -> None:
    root = ElementTree.fromstring(messages.urdf("r1", SIZE))
    links = {link.get("name") for link in root.iter("link")}
    state = WheelReader().read(make(WheelTicks, time_ns=0, left=0, right=0), SIZE, 0)
    tree = [
        *messages.static_transforms(SIZE, 0).transforms,
        *messages.wheel_transforms(state, SIZE),
        messages.base_transform(HERE, 0),
    ]
    parents = {one.child_frame_id: one.header.frame_id for one in tree}
    assert len(parents) == len(tree)
    assert links == set(parents) - {"odom"}
    for frame in links:
        while frame != "map":
            frame = parents[str(frame)]
    joints = {joint.get("name"): joint for joint in root.iter("joint")}
    assert set(messages.JOINTS) <= set(joints)


def test_sonars_are_on_the_rim_and_look_outwards() -> None:
    found = {one.child_frame_id: one for one in messages.static_transforms(SIZE, 0).transforms}
    for number, bearing_rad in enumerate(BEARINGS_RAD):
        where = found[f"sonar_{number}"].transform
        assert hypot(where.translation.x, where.translation.y) == pytest.approx(0.2)
        assert yaw_of(where.rotation) == pytest.approx(bearing_rad)


def test_stamps_follow_the_fastest_message() -> None:
    clock, day_ns = RosClock(), 1_790_000_000 * NS_PER_S
    for period, delay_ms in enumerate((30, 2, 45, 60)):
        stamp_ns = period * NS_PER_S
        clock.note(stamp_ns, day_ns + stamp_ns + delay_ms * 1_000_000)
    assert clock.of(3 * NS_PER_S) == day_ns + 3 * NS_PER_S + 2_000_000


def test_stamps_of_a_simulation_are_its_own() -> None:
    clock = RosClock()
    clock.note(5, 1_790_000_000 * NS_PER_S)
    clock.is_simulated = True
    assert clock.of(5) == 5


def test_stamps_begin_anew_when_the_robot_restarts() -> None:
    clock, day_ns = RosClock(), 1_790_000_000 * NS_PER_S
    clock.note(500 * NS_PER_S, day_ns)
    clock.note(1, day_ns + 5)
    assert clock.of(1) == day_ns + 5


def test_dimensions_are_those_among_the_parameters() -> None:
    found = Geometry.of({"radius_m": 0.5, "sonar_max_m": 2.0, "other": 1.0})
    assert (found.radius_m, found.sonar_max_m, found.track_m) == (0.5, 2.0, Geometry().track_m)


def test_plan_leads_over_the_virtual_goal() -> None:
    status = make(NavigatorStatus, goal=GoalState.AVOIDING, goal_x_m=4.0, goal_y_m=5.0)
    decision = make(AvoidanceDecision, virtual_x_m=2.0, virtual_y_m=3.0)
    places = markers.places_of(HERE, status, decision)
    assert places == [(1.25, -2.5), (2.0, 3.0), (4.0, 5.0)]
    assert len(markers.places_of(HERE, status, None)) == 2
    assert len(markers.places_of(HERE, status, make(AvoidanceDecision, virtual_x_m=nan))) == 2
    ended = make(NavigatorStatus, goal=GoalState.REACHED)
    assert markers.places_of(HERE, ended, decision) == []
    (_, middle, _) = markers.plan(places, 5).poses
    assert (middle.pose.position.x, middle.header.frame_id) == (2.0, "map")


def test_markers_are_messages_of_ros() -> None:
    scan = make(SonarScan, range_mm=(500,) * 8, ping_age_us=(0,) * 8, valid=3, echo=1)
    pose = make(PlanarOdometry, cov_xx_m2=0.04, cov_yy_m2=0.01)
    decision = make(AvoidanceDecision, branch=Branch.PASS_LEFT)
    places = [(0.0, 0.0), (1.0, 0.0), (2.0, 0.0)]
    found = markers.markers(pose, places, decision, scan, SIZE, 7)
    name, interfaces = "visualization_msgs/msg/MarkerArray", Interfaces(Distro.JAZZY)
    read = interfaces.decode(name, interfaces.encode(name, found)).markers
    shown = {one.ns: one for one in read}
    assert list(shown) == ["goal", "virtual_goal", "decision", "doubt", "sonars"]
    assert (shown["goal"].pose.position.x, shown["virtual_goal"].pose.position.x) == (2.0, 1.0)
    assert shown["decision"].text == "pass left"
    assert shown["doubt"].scale.x == pytest.approx(2 * shown["doubt"].scale.y)
    assert len(shown["sonars"].points) == 3
    lost = make(PlanarOdometry, cov_xx_m2=nan)
    assert markers.markers(lost, [], None, None, SIZE, 7).markers == []


def test_nothing_is_shown_before_the_clock_is_known() -> None:
    day_ns = 1_790_000_000 * NS_PER_S
    simulated, real = RobotTopics("r1"), RobotTopics("r1")
    assert not list(simulated.take(HERE, day_ns))
    now = SystemTime(time_unix_usec=HERE.time_ns // 1000, time_boot_ms=0)
    assert [name for name, _ in simulated.take(now, day_ns)] == ["/clock"]
    (found, _) = simulated.take(HERE, day_ns)
    assert found[1].header.stamp.sec == HERE.time_ns // NS_PER_S
    assert not list(real.take(HERE, day_ns))
    later_ns = NS_PER_S // 4
    (found, _) = real.take(HERE, day_ns + later_ns)
    assert found[1].header.stamp.sec == 1_790_000_000
