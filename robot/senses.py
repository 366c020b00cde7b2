"""What the robot senses in this tick, and when on the plant's clock this tick is."""

from collections.abc import Callable
from typing import Final, TypeVar

from protocol.bus import Bus
from protocol.clock import Tick
from protocol.mailbox import Mailbox
from protocol.messages import SonarScan, WheelTicks
from protocol.topics import OPERATOR, SONAR, WHEELS
from robot.core.senses import now_ms_of, scan_of, wheels_of
from robot.core.values import Inputs
from robot.vehicle import Vehicle

PERIOD_NS: Final = 50_000_000

Sense = TypeVar("Sense", SonarScan, WheelTicks)


class Senses:
    """Mailboxes of one robot; `beat` gets the arrival of each scan.

    The age of a sense is told by when it arrived here, in lockstep by its stamp: there, time goes
    on only with the clock's own frames. `stamp_ns` and `sequence` are those of the last tick read,
    `ping_age_us` is how old its oldest ping was when the scan was sent.
    """

    def __init__(
        self, bus: Bus, *, lockstep: bool, beat: Callable[[int], None] | None = None
    ) -> None:
        self.lockstep = lockstep
        self._wheels = bus.mailbox(WHEELS)
        self._sonar = bus.mailbox(SONAR, notify=beat)
        self._operator = bus.mailbox(OPERATOR)
        self._heard_ns: int | None = None
        self.stamp_ns = self.sequence = self.ping_age_us = 0

    def read(self, tick: Tick, now_ns: int, vehicle: Vehicle) -> Inputs:
        """The senses of this tick; None where one is missing or stale."""
        wheels = self._fresh(self._wheels, now_ns)
        scan = self._fresh(self._sonar, now_ns)
        self._place(tick, now_ns)
        self._listen(vehicle, now_ns)
        if scan is not None:
            self.ping_age_us = max(scan.ping_age_us)
        return Inputs(
            now_ms_of(now_ns),
            None if wheels is None else wheels_of(wheels),
            None if scan is None else scan_of(scan),
            vehicle.operator_age_ms(now_ns),
        )

    def _fresh(self, mailbox: Mailbox[Sense], now_ns: int) -> Sense | None:
        newest = mailbox.latest()
        if newest is None:
            return None
        message, arrived_ns = newest
        age_ns = now_ns - (message.time_ns if self.lockstep else arrived_ns)
        return message if age_ns <= mailbox.topic.stale_after_ns else None

    def _place(self, tick: Tick, now_ns: int) -> None:
        """This tick is at the stamp of its scan, or so much after the last one."""
        if self.lockstep:
            self.stamp_ns, self.sequence = now_ns, now_ns // PERIOD_NS
            return
        newest = self._sonar.latest()
        if newest is not None:
            scan, arrived_ns = newest
            self.stamp_ns = scan.time_ns + max(0, tick.due_ns - arrived_ns)
            self.sequence = scan.seq

    def _listen(self, vehicle: Vehicle, now_ns: int) -> None:
        newest = self._operator.latest()
        if newest is not None and newest[1] != self._heard_ns:
            self._heard_ns = newest[1]
            vehicle.hear_operator(now_ns)
