"""Wheel commands of the robot: their epoch, and the last command."""

from collections.abc import Callable
from time import time
from typing import cast

from protocol.bus.bus import Bus
from protocol.topics import DRIVE, HEARTBEAT
from protocol.wire.messages import WheelCommand
from robot.core.parameters import DEFAULTS
from robot.reports import Reports
from robot.run import epoch
from robot.storage import Store
from robot.vehicle import Vehicle
from runtime.clock import ManualClock
from runtime.units import PERIOD_NS
from tests.support.each import each
from tests.support.played_bus import PlayedBus

MS, SECOND = 1_000_000, 1_000_000_000


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


def beats_in(seconds: float, *, factor: float, late_ms: Callable[[int], int]) -> int:
    """Return the number of heartbeats in wall time with a tick every 50 ms of simulated time."""
    clock, vehicle = ManualClock(10 * SECOND), Vehicle(DEFAULTS, Store(None))
    bus = PlayedBus(clock)
    reports = Reports(cast(Bus, bus))
    beats = bus.publisher(HEARTBEAT).said
    begun_ns = clock.now_ns()
    for tick in range(round(seconds * factor * 20)):
        due_ns = begun_ns + round(tick * PERIOD_NS / factor) + late_ms(tick) * MS
        clock.advance(due_ns - clock.now_ns())
        reports.events(vehicle, 0, tick * PERIOD_NS + late_ms(tick) * MS)
    return len(beats)


def test_heartbeats_keep_their_rate_although_ticks_jitter() -> None:
    jitter = (0, 1, 0, 3, 2, 0, 1)
    assert beats_in(30.0, factor=1.0, late_ms=lambda tick: jitter[tick % 7]) in (150, 151)


@each("factor", [0.1, 0.3])
def test_heartbeats_go_on_when_simulated_time_is_slow(factor: float) -> None:
    period_s = max(0.3, 0.05 / factor) + 0.05 / factor
    assert beats_in(30.0, factor=factor, late_ms=lambda _: 0) >= 30.0 / period_s - 1


def test_every_wheel_command_carries_the_epoch() -> None:
    assert [command.epoch for command in decoded(1_800_000_000, 5, 6)] == [1_800_000_000] * 2


def test_the_epoch_is_the_time_in_seconds() -> None:
    before = int(time())
    assert before <= epoch() <= int(time())


@each("stamp_ns", [0, (1 << 62) - 1, 1 << 62, 1 << 64, 1 << 80, -1])
@each("sense_seq", [0, (1 << 32) - 1, 1 << 32, -1])
def test_last_brake_has_a_valid_stamp(stamp_ns: int, sense_seq: int) -> None:
    """Invalid stamps would let the wheels run on until the last command expires."""
    last = decoded(0, stamp_ns, sense_seq)[-1]
    assert (last.seq, last.left_mrad_s, last.right_mrad_s, last.ttl_ms) == (1, 0, 0, 0)
