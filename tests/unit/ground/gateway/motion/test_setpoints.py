from math import cos, inf, nan, pi, sin
from typing import Any

import pytest

from gateways.mavlink.coordinates import PER_DEG
from gateways.mavlink.mavlink_dialect import MavMessage
from gateways.mavlink.motion.setpoints import SetpointError, Velocity, attitude_of, setpoint_of
from ground.client.goal import Destination
from ground.missions.qgroundcontrol import to_global
from tests.support.each import each
from tests.support.gateway.fake_port import ORIGIN
from tests.support.gateway.messages import SPEEDS, attitude, global_target, local_target
from tests.support.gateway.telemetry import odometry

EAST = odometry(x_m=3.0, y_m=4.0, heading_rad=0.0)
LOCAL_NED, OFFSET_NED, BODY_NED, BODY_OFFSET_NED = 1, 7, 8, 9


def position(frame: int, x: float, y: float, yaw: float | None = None) -> Destination:
    mask = 0xDF8 if yaw is None else 0x9F8
    message = local_target(frame=frame, mask=mask, x=x, y=y, yaw=yaw or 0.0)
    found = setpoint_of(message, EAST, ORIGIN)
    assert isinstance(found, Destination)
    return found


def velocity(pose: Any = EAST, **fields: Any) -> Velocity:
    found = setpoint_of(local_target(**fields), pose, ORIGIN)
    assert isinstance(found, Velocity)
    return found


@each(
    ("frame", "expected"),
    [
        (LOCAL_NED, (2.0, 1.0)),
        (OFFSET_NED, (5.0, 5.0)),
        (BODY_NED, (4.0, 2.0)),
        (BODY_OFFSET_NED, (4.0, 2.0)),
    ],
)
def test_position_in_each_frame(frame: int, expected: tuple[float, float]) -> None:
    goal = position(frame, x=1.0, y=2.0)
    assert (goal.x_m, goal.y_m) == pytest.approx(expected)
    assert goal.heading_rad is None


def test_yaw_of_a_position_is_its_heading() -> None:
    assert position(LOCAL_NED, 1, 2, yaw=pi / 2).heading_rad == pytest.approx(0.0)
    assert position(BODY_NED, 1, 2, yaw=pi / 2).heading_rad == pytest.approx(-pi / 2)
    assert position(LOCAL_NED, 1, 2, yaw=nan).heading_rad is None


def test_global_position() -> None:
    latitude_deg, longitude_deg = to_global(ORIGIN, 12.0, -7.0)
    place = round(latitude_deg * PER_DEG), round(longitude_deg * PER_DEG)
    found = setpoint_of(global_target(lat=place[0], lon=place[1]), EAST, ORIGIN)
    assert isinstance(found, Destination)
    assert (found.x_m, found.y_m) == pytest.approx((12.0, -7.0), abs=0.02)


@each(
    ("fields", "expected"),
    [
        ({"vx": 0.5}, Velocity(0.5, heading_rad=pi / 2)),
        ({"vy": 0.5}, Velocity(0.5, heading_rad=0.0)),
        ({"vx": 0.5, "mask": SPEEDS & ~2048, "yaw_rate": 0.2}, Velocity(0.5, -0.2)),
        ({"vx": -0.5, "mask": SPEEDS & ~2048, "yaw_rate": 0.2}, Velocity(-0.5, -0.2)),
        ({"vy": -0.5, "mask": SPEEDS & ~1024, "yaw": pi / 2}, Velocity(-0.5, heading_rad=0.0)),
        ({"vx": 0.5, "frame": BODY_NED}, Velocity(0.5)),
        ({"vx": -0.5, "frame": BODY_NED}, Velocity(-0.5)),
        ({"vy": 0.5, "frame": BODY_NED}, Velocity(0.5, heading_rad=-pi / 2)),
        ({"mask": 0x5FF, "yaw_rate": 0.3}, Velocity(0.0, -0.3)),
        ({"mask": 0x9FF, "yaw": 0.0}, Velocity(heading_rad=pi / 2)),
        ({"mask": 0x9FF, "yaw": 0.5, "frame": BODY_NED}, Velocity(heading_rad=-0.5)),
    ],
)
def test_velocities(fields: dict[str, Any], expected: Velocity) -> None:
    found = velocity(**fields)
    assert found[:2] == pytest.approx(expected[:2])
    assert found.heading_rad == pytest.approx(expected.heading_rad)


def test_position_goes_before_velocity() -> None:
    assert isinstance(setpoint_of(local_target(mask=0xDC0), EAST, ORIGIN), Destination)


@each(
    "fields",
    [
        {"frame": 0},
        {"frame": 2},
        {"frame": 12},
        {"frame": 255},
        {"mask": 0xC07},
        {"mask": SPEEDS | 512},
        {"mask": 0xFFFF},
        {"mask": 0xDFF},
        {"vx": nan},
        {"vy": inf},
        {"mask": SPEEDS & ~2048, "yaw_rate": nan},
        {"mask": SPEEDS & ~1024, "yaw": inf},
        {"mask": 0xDF8, "x": nan},
        {"mask": 0xDF8, "x": 1e38},
        {"mask": 0xDF8, "x": -inf, "frame": BODY_NED},
        {"mask": 0xDF8, "x": 1.9e6, "y": 1.9e6, "frame": BODY_NED, "pose": pi / 4},
    ],
)
def test_setpoint_that_cannot_be_followed(fields: dict[str, Any]) -> None:
    pose = odometry(heading_rad=fields.pop("pose", 0.0))
    with pytest.raises(SetpointError):
        setpoint_of(local_target(**fields), pose, ORIGIN)


@each(
    ("lat", "lon"),
    [(0, 0), (2**31 - 1, 0), (-(2**31), -(2**31)), (900_000_001, 1), (-1, 180 * 10**7)],
)
def test_place_that_is_none(lat: int, lon: int) -> None:
    with pytest.raises(SetpointError):
        setpoint_of(global_target(lat=lat, lon=lon), EAST, ORIGIN)


@each("frame", [OFFSET_NED, BODY_NED])
def test_offset_without_a_pose_is_refused(frame: int) -> None:
    with pytest.raises(SetpointError, match="pose"):
        setpoint_of(local_target(frame=frame, mask=0xDF8, x=1.0), None, ORIGIN)


def quaternion(yaw_rad: float) -> tuple[float, ...]:
    return cos(yaw_rad / 2), 0.0, 0.0, sin(yaw_rad / 2)


def test_attitude_is_a_share_of_the_speed_and_a_turn() -> None:
    found = attitude_of(attitude(thrust=0.5, rate=0.25), 0.8)
    assert found == Velocity(0.4, -0.25)
    assert attitude_of(attitude(thrust=-9.0), 0.8).speed_m_s == pytest.approx(-0.8)


def test_attitude_without_a_rate_is_a_heading() -> None:
    found = attitude_of(attitude(thrust=0.5, mask=4, q=quaternion(pi / 2)), 0.8)
    assert found.heading_rad == pytest.approx(0.0)


@each(
    "message",
    [
        attitude(thrust=nan),
        attitude(rate=inf),
        attitude(mask=64),
        attitude(mask=4, q=(0.0,) * 4),
        attitude(mask=4, q=(nan,) * 4),
    ],
)
def test_attitude_that_cannot_be_followed(message: MavMessage) -> None:
    with pytest.raises(SetpointError):
        attitude_of(message, 0.8)


def test_attitude_needs_the_fastest_speed() -> None:
    with pytest.raises(SetpointError, match="fastest"):
        attitude_of(attitude(), None)


def test_twist_turns_to_the_heading_before_it_drives() -> None:
    wanted = Velocity(0.5, heading_rad=pi / 2)
    assert wanted.twist(0.0) == pytest.approx((0.0, 1.5), abs=1e-9)
    assert wanted.twist(pi / 2) == pytest.approx((0.5, 0.0))
    assert wanted.twist(None) == (0.0, 0.0)


def test_twist_is_bounded() -> None:
    assert Velocity(1e30, -1e30).twist(None) == pytest.approx((5.0, -4.0 * pi))
