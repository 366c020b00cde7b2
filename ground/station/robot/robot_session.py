"""One robot as its operator has it: the lease and the heart, the way to it, and the e-stop."""

from collections.abc import Callable

from ground.client.emergency_stop import EmergencyStop, outcome_words
from ground.station.bus_protocols import LiveBus, MessagePublisher
from ground.station.link.link_monitor import LinkMonitor
from ground.station.link.loss import Loss, LossKind
from ground.station.reader import Reader
from ground.station.robot.background_requests import JobResult, RequestWorker
from ground.station.robot.lease_holding import LeaseHolding
from ground.station.robot.robot_model import RobotModel, Tell
from protocol.topics import LEASE, OPERATOR, STATUS, STOP, Role
from protocol.wire.enums import Severity
from protocol.wire.messages import CommandRequest, Heartbeat
from runtime.clock import Clock


class RobotSession:
    """Beats at `poll` and nowhere else, so that an app that hangs is no operator any more."""

    def __init__(
        self,
        bus: LiveBus,
        watched: RobotModel,
        clock: Clock,
        lanes: Callable[[str], RequestWorker],
        tell: Tell,
    ) -> None:
        robot, now_ns = watched.robot, clock.now_ns()
        self.tenure = LeaseHolding(bus.operator or "")
        self._lanes = [lanes(f"{robot} reads"), lanes(f"{robot} e-stop")]
        reader = Reader(bus, clock, robot, self._lanes[0])
        self.vigil = LinkMonitor(watched, reader, now_ns, tell)
        self._bus = bus
        self._watched = watched
        self._clock = clock
        self._tell = tell
        self._reader = reader
        self._heart: MessagePublisher[Heartbeat] = bus.publisher(OPERATOR, robot)
        self._stops: MessagePublisher[CommandRequest] = bus.publisher(STOP, robot)
        self._stop: EmergencyStop | None = None
        self._over = False
        bus.announce(robot)

    def poll(self, now_ns: int, again: set[Role]) -> None:
        self._hear_lease(now_ns)
        self.vigil.poll(now_ns, again, self.tenure.lease)
        self.beat(now_ns)
        self._see_stop(now_ns)

    def beat(self, now_ns: int) -> None:
        newest = self._watched.telemetry.latest(STATUS)
        self.tenure.beat(self._heart, now_ns, 0 if newest is None else newest[0].time_ns)

    def refusal(self) -> str:
        """Why nothing that moves may be asked now; empty when it may."""
        loss: Loss | None = self.vigil.loss()
        if loss is not None:
            todo = "; `lease seize` takes it" if loss.kind is LossKind.OTHER_OPERATOR else ""
            return f"{loss.kind.value.lower()}: {loss.what}{todo}"
        if not self.vigil.contact.ready:
            return f"not yet: waiting for {self.vigil.waiting_for} of {self._watched.robot}"
        return ""

    @property
    def parameters_words(self) -> str:
        return self._watched.parameters.words(self._reader.asked)

    # The e-stop.

    def estop(self) -> None:
        """Press it: sent at once, then repeated in a thread. A press under way is sent again."""
        if self._stop is not None:
            self._stop.press()
            self._tell("ground", self._stop.words(self._clock.now_ns()), Severity.CRITICAL)
            return
        robot, telemetry = self._watched.robot, self._watched.telemetry
        stop = EmergencyStop(
            self._bus, self._stops, robot, self._clock, lambda: telemetry.latest(STATUS)
        )
        self._stop = stop
        stop.press()
        self._lanes[1].start(lambda: self._repeat(stop))

    def _repeat(self, stop: EmergencyStop) -> JobResult:
        outcome = stop.run(lambda: self._over)
        return JobResult(outcome.acknowledged, outcome_words(outcome, stop.robot))

    @property
    def stopping(self) -> str:
        return "" if self._stop is None else self._stop.words(self._clock.now_ns())

    def _see_stop(self, now_ns: int) -> None:
        if self._stop is None:
            return
        outcome = self._lanes[1].done()
        if outcome is not None:
            self._stop = None
            loss = self.vigil.loss()
            text = outcome.text if outcome.ok or loss is None else f"{outcome.text}; {loss.does}"
            self._tell("ground", text, Severity.WARNING if outcome.ok else Severity.EMERGENCY)
        elif words := self._stop.due(now_ns):
            self._tell("ground", words, Severity.CRITICAL)

    def _hear_lease(self, now_ns: int) -> None:
        newest = self._watched.telemetry.latest(LEASE)
        if newest is None:
            return
        lost = self.tenure.heard(newest[0], newest[1], now_ns)
        if lost:
            self._tell("ground", f"{self._watched.robot}: {lost}", Severity.WARNING)

    def close(self, deadline_s: float) -> None:
        """Ends its threads by then."""
        self._over = True
        for lane in self._lanes:
            lane.close(deadline_s)
