"""Driving by hand: what is sent, what no robot could do, and when it is over."""

import argparse
from math import nan

import pytest
from msgspec.structs import replace

from ground.cli.command.teleop import SETTLE_NS, TTL_MS, Stick, judge, taken_away
from protocol.wire.enums import Mode, Vehicle
from protocol.wire.messages import Teleop
from protocol.wire.reasons import Reason
from runtime.clock import ManualClock
from runtime.errors import UserError
from tests.support.ground.client import status

LATER_NS = SETTLE_NS + 1


class Wire:
    """The bus of a link, as far as a stick needs one."""

    robot = "r1"

    def __init__(self) -> None:
        self.clock = ManualClock(7)
        self.sent: list[Teleop] = []
        self.declared = 0

    @property
    def bus(self) -> "Wire":
        return self

    def publisher(self, *_: object) -> "Wire":
        self.declared += 1
        return self

    def await_matched(self, *_: object, timeout_s: float) -> list[str]:
        return []

    def put(self, frame: Teleop) -> None:
        self.sent.append(frame)


def test_a_stick_counts_its_frames_and_each_is_good_for_a_moment_only() -> None:
    wire = Wire()
    stick = Stick(wire)  # type: ignore[arg-type]
    stick.drive(0.25, -0.5)
    wire.clock.advance(50)
    stick.stop()
    assert wire.sent == [
        Teleop(time_ns=7, seq=1, speed_mm_s=250, yaw_rate_mrad_s=-500, ttl_ms=TTL_MS),
        Teleop(time_ns=57, seq=2, speed_mm_s=0, yaw_rate_mrad_s=0, ttl_ms=TTL_MS),
    ]
    assert wire.declared == 1
    assert TTL_MS <= 500


@pytest.mark.parametrize(
    ("speed", "turn", "why"),
    [
        (9.0, 0.0, "speed 9 m/s is out of range: -5 to 5 m/s"),
        (nan, 0.0, "speed nan m/s is out of range"),
        (0.0, -9000.0, "turn -9000 deg/s is out of range"),
    ],
)
def test_what_no_robot_could_do_is_refused(speed: float, turn: float, why: str) -> None:
    options = argparse.Namespace(speed=speed, turn=turn, last=None, attended=False)
    with pytest.raises(UserError, match=why):
        judge(options)


def test_in_the_app_somebody_must_say_for_how_long() -> None:
    options = argparse.Namespace(speed=0.1, turn=0.0, last=None, attended=True)
    with pytest.raises(UserError, match="teleop for the keys"):
        judge(options)
    options.last = 1.0
    judge(options)


def test_it_is_over_when_the_robot_is_stopped_or_leaves_manual() -> None:
    manual = status(Vehicle.ACTIVE)
    driving = replace(manual, mode=Mode.MANUAL)
    stopped = replace(driving, vehicle=Vehicle.EMERGENCY_STOP)
    blamed = replace(stopped, vehicle_reason=Reason.BUMPER)
    assert taken_away(driving, LATER_NS) == ""
    assert taken_away(manual, LATER_NS) == "the robot has left MANUAL"
    assert taken_away(stopped, LATER_NS) == "not armed"
    assert taken_away(blamed, LATER_NS) not in ("", "not armed")


def test_what_was_so_before_the_robot_has_understood_is_no_end() -> None:
    assert taken_away(status(Vehicle.STANDBY), 0) == ""
