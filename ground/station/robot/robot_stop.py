"""Send the e-stop of one robot, repeat it until acknowledged, and remember the last one."""

from collections import deque
from contextlib import suppress
from functools import partial
from threading import Thread
from typing import Final, NamedTuple

from ground.client import stop_ways
from ground.client.emergency_stop import EmergencyStop, MessagePublisher, StopOutcome, outcome_words
from ground.station.robot.robot_model import AddLine, RobotModel
from protocol.bus.bus import Bus
from protocol.topics import STATUS, STOP
from protocol.wire.enums import Severity
from protocol.wire.messages import CommandRequest
from runtime.clock import Clock

MAX_EARLIER: Final = 16


class StopRecord(NamedTuple):
    """The last e-stop that this station sent to a robot; `took_ns` None: not acknowledged."""

    request_id: int
    pressed_ns: int
    took_ns: int | None
    earlier: tuple[int, ...] = ()
    """The ids of earlier stops of this station, of which one may still be shown."""


class RobotStop:
    """The e-stop of one robot: needs no lease, waits for nothing and is never rejected."""

    def __init__(
        self,
        bus: Bus,
        model: RobotModel,
        clock: Clock,
        add_line: AddLine,
    ) -> None:
        self._bus = bus
        self._model = model
        self._clock = clock
        self._add_line = add_line
        self._publisher: MessagePublisher[CommandRequest] = bus.publisher(STOP, model.robot)
        self._ways = stop_ways.ways_of(bus, model.robot)
        self._pending: EmergencyStop | None = None
        self._is_repeated = False
        self._last: EmergencyStop | None = None
        self._earlier: deque[int] = deque(maxlen=MAX_EARLIER)
        self._outcome: StopOutcome | None = None
        self._over = False

    def press(self) -> None:
        """Send the e-stop once, without blocking; a pending one is sent again."""
        if self._pending is not None:
            self._pending.press()
            self._add_line("ground", self.words, Severity.CRITICAL)
            return
        telemetry = self._model.telemetry
        stop = EmergencyStop(
            self._bus,
            self._publisher,
            self._model.robot,
            self._clock,
            lambda: telemetry.latest(STATUS),
            self._ways,
        )
        stop.press()
        if self._last is not None:
            self._earlier.append(self._last.request_id)
        self._pending = self._last = stop
        self._is_repeated, self._outcome = False, None

    def repeat(self) -> None:
        """Repeat a pressed e-stop in a thread until the robot's status shows it."""
        stop = self._pending
        if stop is None or self._is_repeated or self._over:
            return
        repeating = Thread(
            target=partial(self._run, stop), name=f"{stop.robot} e-stop", daemon=True
        )
        with suppress(RuntimeError):  # this system can make no thread now: the next press repeats
            repeating.start()
            self._is_repeated = True

    def _run(self, stop: EmergencyStop) -> None:
        self._outcome = stop.run(lambda: self._over)

    @property
    def is_pending(self) -> bool:
        """True until the e-stop is acknowledged or given up."""
        return self._pending is not None

    @property
    def words(self) -> str:
        """State of the pending e-stop in words; empty without one."""
        return "" if self._pending is None else self._pending.words(self._clock.now_ns())

    @property
    def record(self) -> StopRecord | None:
        """The last e-stop of this station; None before the first."""
        stop, outcome = self._last, self._outcome
        if stop is None:
            return None
        took_ns = outcome.took_ns if outcome is not None and outcome.acknowledged else None
        return StopRecord(stop.request_id, stop.pressed_ns, took_ns, tuple(self._earlier))

    def report(self, now_ns: int, response: str) -> None:
        """Log the end of the e-stop, or each second that there is none.

        `response` is what the robot does by itself while it cannot be reached; empty if it can.
        """
        if self._pending is None:
            return
        outcome = self._outcome
        if outcome is not None:
            ok, text = outcome.acknowledged, outcome_words(outcome, self._pending.robot)
            self._pending = None
            text = text if ok or not response else f"{text}; {response}"
            self._add_line("ground", text, Severity.WARNING if ok else Severity.EMERGENCY)
        elif words := self._pending.due(now_ns):
            self._add_line("ground", words, Severity.CRITICAL)

    def close(self) -> None:
        """Let the thread end."""
        self._over = True
        self._ways.close()
