"""Bytes that are no frames, on every topic and service, are counted, shown and ignored."""

import pytest

from protocol.topics import CLOCK, DRIVE, OPERATOR, SONAR, STOP, TOPICS, WHEELS
from protocol.wire.codec import Encoder
from protocol.wire.enums import Vehicle
from protocol.wire.messages import WheelTicks
from tests.support.each import each
from tests.support.harness import Stack

GOOD = Encoder(1, 25).encode(WheelTicks(time_ns=1, seq=1, left=5, right=5, bumper=0, expired=0))
BROKEN = (b"", b"\x00", GOOD[:-1], GOOD[:9], b"\xff" * 300, GOOD[:-1] + b"\x00", b"\xfd rubbish")


def test_invalid_bytes_do_not_prevent_reaching_the_goal() -> None:
    with Stack("open") as stack:
        stack.arm()
        stack.goto_goal()
        for topic in TOPICS:
            for frame in BROKEN if topic is not STOP else ():
                stack.send_raw(topic, frame)
                stack.forward(0.05)
        stack.until(stack.reached)
        stack.assert_near(stack.world.goal.x_m, stack.world.goal.y_m)


@each("frame", BROKEN)
def test_any_bytes_on_the_stop_topic_are_a_stop(frame: bytes) -> None:
    with Stack("open") as stack:
        stack.arm()
        stack.goto_goal()
        stack.forward(0.5)
        stack.send_raw(STOP, frame)
        stack.forward(0.1)
        assert stack.state == Vehicle.EMERGENCY_STOP


def test_a_message_on_the_wrong_topic_is_not_taken_for_another() -> None:
    with Stack("open") as stack:
        stack.arm()
        stack.goto_goal()
        for topic in (SONAR, DRIVE, OPERATOR, CLOCK):
            stack.send_raw(topic, GOOD)
            stack.forward(0.05)
        stack.until(stack.reached)


def test_what_cannot_be_read_is_counted_and_shown() -> None:
    with Stack("open") as stack:
        assert stack.rejected_shown() == 0
        for topic in (SONAR, WHEELS, OPERATOR):
            stack.send_raw(topic, b"\xfd rubbish")
        stack.kill("plant")  # otherwise the next frame would replace the bad one before it is read
        stack.forward(0.1)
        assert stack.rejected_shown() == 3


def test_a_garbled_wheel_command_is_not_obeyed() -> None:
    with Stack("open") as stack:
        stack.send_raw(DRIVE, b"\xfd" + b"\x7f" * 60)
        stack.forward(0.5)
        assert stack.standing()
        assert stack.truth.x_m == pytest.approx(stack.world.start.x_m)
