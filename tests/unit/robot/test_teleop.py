"""Teleop with a dead-man switch: a frame counts for its own time-to-live and no longer."""

from hypothesis import given
from hypothesis import strategies as st

from protocol.wire.limits import MAX_TELEOP_TTL_MS
from protocol.wire.messages import Teleop
from robot.commands import TeleopInput, operator_twist
from robot.core.values import Twist
from tests.support.each import each
from tests.support.robot.vehicles import MS, Desk


def frame(ttl_ms: int, speed_mm_s: int = 200, yaw_rate_mrad_s: int = -500) -> Teleop:
    return Teleop(
        time_ns=0, seq=1, speed_mm_s=speed_mm_s, yaw_rate_mrad_s=yaw_rate_mrad_s, ttl_ms=ttl_ms
    )


def test_no_twist_before_the_first_frame() -> None:
    assert TeleopInput().newest(0) is None
    assert operator_twist(None) is None


@given(
    st.integers(0, MAX_TELEOP_TTL_MS),
    st.integers(0, 10**15),
    st.integers(0, 2 * MAX_TELEOP_TTL_MS * MS),
)
def test_a_frame_counts_until_its_time_is_over(ttl_ms: int, arrived_ns: int, age_ns: int) -> None:
    handle = TeleopInput()
    assert handle.receive(frame(ttl_ms), arrived_ns) == ""
    steered = handle.newest(arrived_ns + age_ns) is not None
    assert steered == (age_ns < ttl_ms * MS)


def test_newer_frame_replaces_one_with_a_later_expiry() -> None:
    handle = TeleopInput()
    assert handle.receive(frame(MAX_TELEOP_TTL_MS, speed_mm_s=200), 0) == ""
    handle.receive(frame(100, speed_mm_s=50), 10 * MS)
    assert operator_twist(handle.newest(100 * MS)) == Twist(0.05, -0.5)
    assert handle.newest(110 * MS) is None


@each("ttl_ms", [MAX_TELEOP_TTL_MS + 1, 65_535])
def test_frame_with_too_long_ttl_is_ignored_and_reported_once(ttl_ms: int) -> None:
    handle = TeleopInput()
    assert f"at most {MAX_TELEOP_TTL_MS}" in handle.receive(frame(ttl_ms), 0)
    assert handle.receive(frame(ttl_ms), 1) == ""
    assert handle.newest(2) is None
    assert handle.receive(frame(100), 3) == ""
    assert f"at most {MAX_TELEOP_TTL_MS}" in handle.receive(frame(ttl_ms), 4)


def test_vehicle_announces_an_ignored_frame() -> None:
    desk = Desk()
    desk.vehicle.texts()
    for _ in range(3):
        desk.vehicle.receive_teleop(frame(900), 0)
    announced = "".join(text.text for text in desk.vehicle.texts())
    assert announced == f"teleop ignored: valid for 900 ms, at most {MAX_TELEOP_TTL_MS} are allowed"
