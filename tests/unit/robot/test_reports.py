"""Wheel commands of the robot: their epoch, and the last command."""

from time import time
from typing import cast

import pytest

from protocol.bus.bus import Bus
from protocol.topics import DRIVE
from protocol.wire.messages import WheelCommand
from robot.reports import Reports
from robot.run import epoch
from runtime.clock import ManualClock
from tests.support.played_bus import PlayedBus


def decoded(epoch_s: int, stamp_ns: int, sense_seq: int) -> list[WheelCommand]:
    """Return the fields of a command and a brake that a motor driver reads."""
    bus = PlayedBus(ManualClock())
    reports, publisher = Reports(cast(Bus, bus), epoch_s), bus.publisher(DRIVE)
    box = bus.mailbox(DRIVE)
    read: list[tuple[WheelCommand, int] | None] = []
    publisher.heard = lambda message: bus.say(DRIVE, message)
    reports.command(5, 6, 900, -900)
    read.append(box.latest())
    reports.brake(stamp_ns, sense_seq)
    read.append(box.latest())
    return [newest[0] for newest in read if newest is not None]


def test_every_wheel_command_carries_the_epoch() -> None:
    assert [command.epoch for command in decoded(1_800_000_000, 5, 6)] == [1_800_000_000] * 2


def test_the_epoch_is_the_time_in_seconds() -> None:
    before = int(time())
    assert before <= epoch() <= int(time())


@pytest.mark.parametrize("stamp_ns", [0, (1 << 62) - 1, 1 << 62, 1 << 64, 1 << 80, -1])
@pytest.mark.parametrize("sense_seq", [0, (1 << 32) - 1, 1 << 32, -1])
def test_last_brake_has_a_valid_stamp(stamp_ns: int, sense_seq: int) -> None:
    """Invalid stamps would let the wheels run on until the last command expires."""
    last = decoded(0, stamp_ns, sense_seq)[-1]
    assert (last.seq, last.left_mrad_s, last.right_mrad_s, last.ttl_ms) == (1, 0, 0, 0)
