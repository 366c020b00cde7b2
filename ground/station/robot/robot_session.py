"""Watch and operate one robot: link and e-stop; when selected, lease and heartbeat, too."""

from ground.robot import Robot
from ground.station.link.link_monitor import HubState, LinkMonitor
from ground.station.link.loss import Loss, LossKind
from ground.station.reader import Reader
from ground.station.robot.lease_holding import LeaseHolding
from ground.station.robot.robot_model import AddLine, RobotModel
from ground.station.robot.robot_stop import RobotStop
from protocol.topics import LEASE, STATUS, Role
from protocol.wire.enums import Severity


class RobotSession:
    """An operator's session; only `poll` sends heartbeats, so a hanging app loses its lease.

    A robot is watched, and can be stopped, from the start. All other operations need `select`.
    """

    def __init__(
        self,
        robot: Robot,
        model: RobotModel,
        add_line: AddLine,
        hub_state: HubState,
    ) -> None:
        bus, clock = robot.bus, robot.clock
        self.robot = robot
        self.holding = LeaseHolding(bus.operator or "")
        self.reader = Reader(robot)
        self.link_monitor = LinkMonitor(model, self.reader, clock.now_ns(), add_line, hub_state)
        self.stop = RobotStop(bus, model, clock, add_line)
        self._model = model
        self._add_line = add_line
        self._attends = False

    def select(self) -> None:
        """Read everything of this robot, and announce this station as its operator's."""
        self.reader.watches_only = False
        self._model.is_selected = True
        self._model.follow_all(True)
        self._attend()

    def _attend(self) -> None:
        """Announce this station, once."""
        if not self._attends:
            self._attends = True
            self.robot.lease.declare_heartbeat()
            self.robot.bus.announce(self.robot.name)

    def deselect(self) -> None:
        """Only watch this robot from now on; a held lease is kept."""
        self.reader.watches_only = True
        self._model.is_selected = False

    @property
    def can_end(self) -> bool:
        """True if ending the session gives up neither a lease nor a pending stop."""
        return not self.holding.is_used and not self.stop.is_pending and not self._attends

    @property
    def is_busy(self) -> bool:
        """True if the session must be polled at the full rate."""
        return not self.reader.watches_only or self.holding.is_used or self.stop.is_pending

    def poll(self, now_ns: int, restarted_roles: set[Role]) -> None:
        """Process lease, link and e-stop, and send a heartbeat.

        A robot that this program commands is followed, also while another one is selected.
        """
        self._model.follow_all(not self.reader.watches_only or self.holding.is_used)
        self._update_lease(now_ns)
        self.link_monitor.poll(now_ns, restarted_roles, self.holding.lease)
        self.beat(now_ns)
        loss = self.link_monitor.loss()
        self.stop.report(now_ns, "" if loss is None else loss.response)

    def beat(self, now_ns: int) -> None:
        """Send a heartbeat if it is due."""
        if not self.holding.is_used:
            return
        self._attend()
        newest = self._model.telemetry.latest(STATUS)
        self.holding.beat(self.robot, now_ns, 0 if newest is None else newest[0].time_ns)

    async def leave(self) -> None:
        """Leave the lease to other programs of this person, else give it back."""
        self.holding.release(self.robot.clock.now_ns())
        await self.robot.lease.leave()

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

    def _update_lease(self, now_ns: int) -> None:
        newest = self._model.telemetry.latest(LEASE)
        if newest is None:
            return
        changed = self.holding.receive(newest[0], newest[1], now_ns)
        if changed:
            severity = Severity.INFO if self.holding.ours else Severity.WARNING
            self._add_line("ground", f"{self._model.robot}: {changed}", severity)

    def close(self) -> None:
        """Let the e-stop's thread end."""
        self.stop.close()
