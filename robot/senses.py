"""Read sensor frames and operator frames for a tick, and the tick's time on the plant's clock.

A frame of an operator is late by comparison with the sender's usual delay.
"""

from collections import OrderedDict
from collections.abc import Callable
from typing import Final, TypeVar

from protocol.bus.bus import Bus
from protocol.bus.mailbox import MAX_SENDERS, Origin
from protocol.topics import OPERATOR, SONAR, TELEOP, WHEELS
from protocol.wire.messages import SonarScan, WheelTicks
from robot.core.values import Inputs, Scan, Wheels, now_ms_of, scan_of, wheels_of
from robot.vehicle import RobotVehicle
from runtime.clock import Tick
from runtime.lockstep import LockstepClock
from runtime.sequence import MAX_LATE_NS, MAX_LATE_TICKS, Order, order_of
from runtime.units import PERIOD_NS, UINT32

MAX_EXTRA_NS: Final = 200_000_000
"""A frame may be later than is usual for its sender by this much."""

SPAN_NS: Final = 5_000_000_000
"""The usual delay is the minimum over this time span and the one before it."""


class UsualDelay:
    """The minimum delay of one sender over the last two time spans."""

    __slots__ = ("_before_ns", "_least_ns", "_since_ns")

    def __init__(self, delay_ns: int, now_ns: int) -> None:
        self._before_ns = self._least_ns = delay_ns
        self._since_ns = now_ns

    def update(self, delay_ns: int, now_ns: int) -> int:
        """Include a delay and return the minimum."""
        if now_ns - self._since_ns >= SPAN_NS:
            self._before_ns, self._least_ns = self._least_ns, delay_ns
            self._since_ns = now_ns
        self._least_ns = min(self._least_ns, delay_ns)
        return min(self._least_ns, self._before_ns)


class DelayFilter:
    """Detects late frames by sender; only the most recent senders are kept."""

    def __init__(self) -> None:
        self._usual: OrderedDict[str, UsualDelay] = OrderedDict()

    def is_late(self, sender: str, sent_ns: int, arrived_ns: int) -> bool:
        """Return whether a frame is more than MAX_EXTRA_NS later than usual for its sender."""
        delay_ns = arrived_ns - sent_ns
        usual = self._usual.get(sender)
        if usual is None:
            usual = self._usual[sender] = UsualDelay(delay_ns, arrived_ns)
        self._usual.move_to_end(sender)
        if len(self._usual) > MAX_SENDERS:
            self._usual.popitem(last=False)
        return delay_ns - usual.update(delay_ns, arrived_ns) > MAX_EXTRA_NS


Sense = TypeVar("Sense", WheelTicks, SonarScan)
WRAP: Final = UINT32 + 1
"""The plant counts control periods in 32 bits."""


class Senses:
    """Mailboxes of one robot.

    `beat` receives the arrival time of each scan. `accept` returns whether an operator's frames
    count. The age of a sensor frame counts from its arrival; in lockstep from its stamp, because
    there only clock frames advance the time; `clock` detects a restart of the plant. The age of an
    operator's frame counts from its sending
    time, so that a late frame extends nothing; in lockstep an accepted frame counts from now.

    `stamp_ns` and `sequence` belong to the last tick read. `ping_age_us` is the age of the oldest
    ping when the scan was sent. `wheels_seq`, `scan_seq` and `scan_age_ms` belong to the newest
    frames used.
    """

    def __init__(
        self,
        bus: Bus,
        *,
        lockstep: bool,
        beat: Callable[[int], None] | None = None,
        accept: Callable[[str], bool] | None = None,
        clock: LockstepClock | None = None,
    ) -> None:
        self.lockstep = lockstep
        self._clock = clock or LockstepClock()
        self._restarts = 0
        self._wheels = bus.mailbox(WHEELS, forward=not lockstep)
        self._sonar = bus.mailbox(SONAR, notify=beat, forward=not lockstep)
        self._operator = bus.mailbox(OPERATOR, accept=accept)
        self._teleop = bus.mailbox(TELEOP, accept=accept)
        self._last_wheels: tuple[WheelTicks, int] | None = None
        self._last_scan: tuple[SonarScan, int] | None = None
        self._delays = DelayFilter()
        self.stamp_ns = self.sequence = self.ping_age_us = 0
        self.wheels_seq = self.scan_seq = self.scan_age_ms = 0

    def read(self, tick: Tick, now_ns: int, vehicle: RobotVehicle) -> Inputs:
        """Return the inputs of this tick, with None for a missing or stale sensor."""
        self.receive_heartbeats(vehicle, now_ns)
        self._receive_teleop(vehicle, now_ns)
        arrived = self._wheels.latest()
        if self._plant_has_restarted(arrived):
            vehicle.lose_position(now_ns)
        wheels = self._last_wheels = newer(arrived, self._last_wheels)
        newest = self._last_scan = newer(self._sonar.latest(), self._last_scan)
        self._set_stamp(newest, tick, now_ns)
        return Inputs(
            now_ms_of(now_ns),
            self._wheels_of(wheels, now_ns),
            self._scan_of(newest, now_ns),
            vehicle.operator_age_ms(now_ns),
        )

    def _plant_has_restarted(self, arrived: tuple[WheelTicks, int] | None) -> bool:
        """Return whether the plant has restarted; in lockstep, forget the frames of the former."""
        if not self.lockstep:
            return is_restarted(arrived, self._last_wheels)
        before, self._restarts = self._restarts, self._clock.restarts
        if before == self._restarts:
            return False
        self._last_wheels = self._last_scan = None
        return True

    def _wheels_of(self, newest: tuple[WheelTicks, int] | None, now_ns: int) -> Wheels | None:
        if newest is None or self._age_ns(newest, now_ns) > WHEELS.stale_after_ns:
            return None
        self.wheels_seq = newest[0].seq
        return wheels_of(newest[0])

    def _scan_of(self, newest: tuple[SonarScan, int] | None, now_ns: int) -> Scan | None:
        if newest is None:
            return None
        age_ns = self._age_ns(newest, now_ns)
        if age_ns > SONAR.stale_after_ns:
            return None
        self.ping_age_us = max(newest[0].ping_age_us)
        self.scan_seq, self.scan_age_ms = newest[0].seq, now_ms_of(age_ns)
        return scan_of(newest[0], self.scan_age_ms)

    def _age_ns(self, newest: tuple[WheelTicks | SonarScan, int], now_ns: int) -> int:
        if self.lockstep:
            return max(0, now_ns - self._clock.offset_ns - newest[0].time_ns)
        return max(0, now_ns - newest[1])

    def _set_stamp(self, newest: tuple[SonarScan, int] | None, tick: Tick, now_ns: int) -> None:
        """Set the time of this tick: its scan's stamp plus the time since then.

        A late scan does not turn the time back; a restarted or paused plant does.
        """
        if self.lockstep:
            self.stamp_ns = now_ns - self._clock.offset_ns
            self.sequence = self.stamp_ns // PERIOD_NS
        elif newest is not None:
            scan, arrived_ns = newest
            stamp_ns = scan.time_ns + max(0, tick.due_ns - arrived_ns)
            if order_of(stamp_ns, self.stamp_ns, MAX_LATE_NS) is not Order.LATE:
                self.stamp_ns = stamp_ns
            self.sequence = scan.seq

    def receive_heartbeats(self, vehicle: RobotVehicle, now_ns: int) -> None:
        """Pass on the newest heartbeat of each program that may command."""
        for _, origin in self._operator.received():
            if self._is_accepted(origin, vehicle):
                vehicle.lease.beat(origin.sender, self._sent_ns(origin, now_ns))

    def _receive_teleop(self, vehicle: RobotVehicle, now_ns: int) -> None:
        """Pass on the newest teleop frame of each program that may command."""
        for teleop, origin in self._teleop.received():
            if self._is_accepted(origin, vehicle):
                sent_ns = self._sent_ns(origin, now_ns)
                vehicle.receive_teleop(teleop, sent_ns, origin.sender)

    def _is_accepted(self, origin: Origin, vehicle: RobotVehicle) -> bool:
        """Return whether a frame is in time and from an operator that may command now."""
        sent_ns, arrived_ns = origin.sent_ns, origin.arrived_ns
        if not origin.sender or sent_ns is None or not vehicle.lease.allows(origin.sender):
            return False
        if self._delays.is_late(origin.sender, sent_ns, arrived_ns):
            return False
        return arrived_ns - sent_ns <= OPERATOR.stale_after_ns

    def _sent_ns(self, origin: Origin, now_ns: int) -> int:
        """Return when a frame was sent, on the clock of this loop."""
        return now_ns if self.lockstep or origin.sent_ns is None else origin.sent_ns


def newer(
    newest: tuple[Sense, int] | None, last: tuple[Sense, int] | None
) -> tuple[Sense, int] | None:
    """Return the frame that was sent last; the network may reorder frames."""
    return last if sending_order(newest, last) is Order.LATE else newest


def is_restarted(newest: tuple[Sense, int] | None, last: tuple[Sense, int] | None) -> bool:
    """Return whether a frame was sent by a restarted plant."""
    return sending_order(newest, last) is Order.RESTARTED


def sending_order(newest: tuple[Sense, int] | None, last: tuple[Sense, int] | None) -> Order:
    """Compare the sequence number of a frame with the last one used."""
    if newest is None or last is None:
        return Order.NEWER
    return order_of(newest[0].seq, last[0].seq, MAX_LATE_TICKS, modulus=WRAP)
