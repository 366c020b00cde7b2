"""Watch and operate one robot: link and e-stop; when selected, lease and heartbeat, too."""

from ground.client.emergency_stop import EmergencyStop, outcome_words
from ground.station.bus_protocols import LiveBus, MessagePublisher
from ground.station.link.link_monitor import HubState, LinkMonitor
from ground.station.link.loss import Loss, LossKind
from ground.station.reader import Reader
from ground.station.robot.background_requests import JobResult, RequestWorker
from ground.station.robot.lease_holding import LeaseHolding
from ground.station.robot.robot_model import AddLine, RobotModel
from protocol.topics import LEASE, OPERATOR, STATUS, STOP, Role
from protocol.wire.enums import Severity
from protocol.wire.messages import CommandRequest, Heartbeat
from runtime.clock import Clock


class RobotSession:
    """An operator's session; only `poll` sends heartbeats, so a hanging app loses its lease.

    A robot is watched, and can be stopped, from the start. All other operations need `select`.
    """

    def __init__(
        self,
        bus: LiveBus,
        model: RobotModel,
        clock: Clock,
        stop_worker: RequestWorker,
        add_line: AddLine,
        hub_state: HubState,
    ) -> None:
        robot, now_ns = model.robot, clock.now_ns()
        self.holding = LeaseHolding(bus.operator or "")
        self.reader = Reader(bus, clock, robot)
        self.link_monitor = LinkMonitor(model, self.reader, now_ns, add_line, hub_state)
        self._stop_worker = stop_worker
        self._bus = bus
        self._model = model
        self._clock = clock
        self._add_line = add_line
        self._heartbeats: MessagePublisher[Heartbeat] | None = None
        self._stop_publisher: MessagePublisher[CommandRequest] = bus.publisher(STOP, robot)
        self._stop: EmergencyStop | None = None
        self._over = False

    def select(self) -> None:
        """Read everything of this robot, and announce this station as its operator's."""
        self.reader.watches_only = False
        self._operate()

    def _operate(self) -> MessagePublisher[Heartbeat]:
        """Return the publisher of heartbeats; announce this station with the first call."""
        if self._heartbeats is None:
            self._heartbeats = self._bus.publisher(OPERATOR, self._model.robot)
            self._bus.announce(self._model.robot)
        return self._heartbeats

    def deselect(self) -> None:
        """Only watch this robot from now on; a held lease is kept."""
        self.reader.watches_only = True

    @property
    def can_end(self) -> bool:
        """True if ending the session gives up neither a lease nor a pending stop."""
        return not self.holding.ours and self._stop is None and self._heartbeats is None

    @property
    def is_busy(self) -> bool:
        """True if the session must be polled at the full rate."""
        return not self.reader.watches_only or self.holding.ours or self._stop is not None

    def poll(self, now_ns: int, restarted_roles: set[Role]) -> None:
        """Process lease, link and e-stop, and send a heartbeat."""
        self._update_lease(now_ns)
        self.link_monitor.poll(now_ns, restarted_roles, self.holding.lease)
        self.beat(now_ns)
        self._report_stop(now_ns)

    def beat(self, now_ns: int) -> None:
        """Send a heartbeat if it is due."""
        if not self.holding.ours:
            return
        newest = self._model.telemetry.latest(STATUS)
        self.holding.beat(self._operate(), now_ns, 0 if newest is None else newest[0].time_ns)

    def refusal(self) -> str:
        """Return why a request that moves the robot is rejected; empty when it is allowed."""
        loss: Loss | None = self.link_monitor.loss()
        if loss is not None:
            todo = "; `lease seize` takes it" if loss.kind is LossKind.OTHER_OPERATOR else ""
            return f"{loss.kind.value.lower()}: {loss.cause}{todo}"
        if not self.link_monitor.contact.ready:
            return f"not ready: waiting for {self.link_monitor.waiting_for} of {self._model.robot}"
        return ""

    @property
    def parameters_words(self) -> str:
        """Number of parameters, or why they are missing."""
        return self._model.parameters.words(self.reader.asked)

    def estop(self) -> None:
        """Send an e-stop at once and repeat it in a thread; a pending one is sent again."""
        if self._stop is not None:
            self._stop.press()
            self._add_line("ground", self._stop.words(self._clock.now_ns()), Severity.CRITICAL)
            return
        robot, telemetry = self._model.robot, self._model.telemetry
        stop = EmergencyStop(
            self._bus, self._stop_publisher, robot, self._clock, lambda: telemetry.latest(STATUS)
        )
        self._stop = stop
        stop.press()
        self._stop_worker.start(lambda: self._repeat(stop))

    def _repeat(self, stop: EmergencyStop) -> JobResult:
        outcome = stop.run(lambda: self._over)
        return JobResult(outcome.acknowledged, outcome_words(outcome, stop.robot))

    @property
    def stopping(self) -> str:
        """State of the pending e-stop in words; empty without one."""
        return "" if self._stop is None else self._stop.words(self._clock.now_ns())

    def _report_stop(self, now_ns: int) -> None:
        if self._stop is None:
            return
        outcome = self._stop_worker.done()
        if outcome is not None:
            self._stop = None
            loss = self.link_monitor.loss()
            text = (
                outcome.text if outcome.ok or loss is None else f"{outcome.text}; {loss.response}"
            )
            self._add_line("ground", text, Severity.WARNING if outcome.ok else Severity.EMERGENCY)
        elif words := self._stop.due(now_ns):
            self._add_line("ground", words, Severity.CRITICAL)

    def _update_lease(self, now_ns: int) -> None:
        newest = self._model.telemetry.latest(LEASE)
        if newest is None:
            return
        lost = self.holding.receive(newest[0], newest[1], now_ns)
        if lost:
            self._add_line("ground", f"{self._model.robot}: {lost}", Severity.WARNING)

    def close(self, deadline_s: float) -> None:
        """End the e-stop's thread before the deadline."""
        self._over = True
        self._stop_worker.close(deadline_s)
