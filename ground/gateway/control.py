"""Operator control: one client of the gateway at a time holds the robot's lease.

The first state-changing command takes the lease if it is free. The gateway sends the operator's
heartbeat to the robot while messages of the client in control arrive. Without them, the robot
reacts as to the loss of any operator. An emergency stop needs no control, and neither does a
command that only stops. Control passes from client to client of the gateway under the same lease.
"""

from typing import Any, Final, NamedTuple

from ground.client.operations import Operation
from ground.client.requests import HeartbeatTimer
from ground.client.results import Accepted, Refused
from ground.gateway.port import Answered, Done, RobotPort, Snapshot
from ground.gateway.traffic import Outbox, Sender
from protocol.wire.enums import LeaseAction
from protocol.wire.reasons import Reason

SILENCE_NS: Final = 3_500_000_000
"""A client in control that is silent for this long loses control. The robot misses its operator
1.5 s later, so that both together are the 5 s of ArduPilot's FS_GCS_TIMEOUT."""
CROSSING_NS: Final = 300_000_000
"""A lease status sent before a change may arrive up to this time after it."""
MAX_TAKING: Final = 64
"""Requests for control that wait for the robot; more are refused."""
BUSY: Final = "too many requests for control at once"


class Owner(NamedTuple):
    """The client in control: a peer, and the system id that it uses."""

    client: int
    system: int


class OperatorControl:
    """Keep the owner, take and release the lease, and send the operator's heartbeat."""

    def __init__(self, port: RobotPort, outbox: Outbox) -> None:
        self.owner: Owner | None = None
        self._takeover_allowed = True
        self._port = port
        self._outbox = outbox
        self._snapshot: Snapshot | None = None
        self._heard_ns = self._changed_ns = 0
        self._now_ns = 0
        self._taking: list[tuple[Sender, Done]] = []
        self._heartbeat = HeartbeatTimer()

    @property
    def is_foreign(self) -> bool:
        """True if an operator on the bus, such as one in the app, holds the lease."""
        lease = None if self._snapshot is None else self._snapshot.lease
        return lease is not None and bool(lease.held) and lease.holder != self._port.identity

    @property
    def takeover_allowed(self) -> bool:
        """True if a request for control is granted without asking the owner."""
        return self._takeover_allowed and (self.owner is not None or not self.is_foreign)

    def holds(self, sender: Sender) -> bool:
        """Return whether the sender is in control."""
        return self.owner == Owner(sender.client, sender.system)

    def heard(self, sender: Sender, now_ns: int) -> None:
        """Record the time of a message of a client."""
        self._now_ns = now_ns
        if self.holds(sender):
            self._heard_ns = now_ns

    def perform(self, sender: Sender, operation: Operation[Any], done: Done) -> None:
        """Start an operation.

        Take control first if it moves the robot and no client has control.
        """
        if not sender.may_command:
            done(Answered(None, sender.barred))
        elif not operation.moves or self.holds(sender):
            self._port.perform(operation, done)
        else:
            self.ensure(sender, lambda answer: self._go_on(answer, operation, done))

    def _go_on(self, answer: Answered, operation: Operation[Any], done: Done) -> None:
        if answer.ok:
            self._port.perform(operation, done)
        else:
            done(answer)

    def ensure(self, sender: Sender, done: Done) -> None:
        """Give control to the sender if no operator has it.

        Otherwise `done` receives the refusal.
        """
        if not sender.may_command:
            done(Answered(None, sender.barred))
        elif self.holds(sender):
            done(Answered(Accepted(0)))
        elif self.owner is not None:
            done(held_by(self.owner.system))
        elif len(self._taking) >= MAX_TAKING:
            done(Answered(None, BUSY))
        else:
            self._taking.append((sender, done))
            if len(self._taking) == 1:
                self._take(sender, LeaseAction.TAKE)

    def request(self, sender: Sender, *, allow_takeover: bool, done: Done) -> None:
        """Give control to the sender if that is permitted.

        Set whether others may take it over.
        """

        def granted(answer: Answered) -> None:
            if answer.ok and self.holds(sender):
                self._takeover_allowed = allow_takeover
            done(answer)

        if self.owner is None or self.holds(sender) or not self.takeover_allowed:
            self.ensure(sender, granted)
        elif not sender.may_command:
            done(Answered(None, sender.barred))
        elif len(self._taking) >= MAX_TAKING:
            done(Answered(None, BUSY))
        else:
            self._taking.append((sender, granted))
            if len(self._taking) == 1:
                self._take(sender, LeaseAction.TAKE)

    def release(self, sender: Sender, done: Done) -> None:
        """Give back the lease if the sender is in control."""
        if not self.holds(sender):
            done(Answered(Accepted(0)) if self.owner is None else held_by(self.owner.system))
            return
        self._lose()
        self._port.change_lease(LeaseAction.RELEASE, "", done)

    def _take(self, sender: Sender, action: LeaseAction) -> None:
        name = f"MAVLink {sender.system}"
        self._port.change_lease(action, name, lambda answer: self._taken(sender, answer))

    def _taken(self, sender: Sender, answer: Answered) -> None:
        waiting, self._taking = self._taking, []
        if answer.ok:
            self.owner = Owner(sender.client, sender.system)
            self._takeover_allowed = True
            self._heard_ns = self._changed_ns = self._now_ns
            self._port.heartbeat()
        for other, done in waiting:
            if answer.ok and not self.holds(other):
                done(held_by(sender.system))
            else:
                done(answer)

    def due(self, snapshot: Snapshot, now_ns: int) -> None:
        """Follow the robot's lease status, and send the heartbeat while the owner is heard."""
        self._now_ns, self._snapshot = now_ns, snapshot
        if self.owner is None:
            return
        if now_ns - self._heard_ns >= SILENCE_NS:
            self._lose()
            return
        lease = snapshot.lease
        is_ours = lease is None or (lease.held and lease.holder == self._port.identity)
        if not is_ours and now_ns > self._changed_ns + CROSSING_NS:
            self._lose()
            return
        stamp_ns = 0 if snapshot.status is None else snapshot.status.time_ns
        if self._heartbeat.due(now_ns, stamp_ns):
            self._port.heartbeat()

    def forget(self, client: int) -> None:
        """Give up control if the client in control has disconnected."""
        if self.owner is not None and self.owner.client == client:
            self._lose()

    def _lose(self) -> None:
        """End the heartbeat.

        The robot then acts as configured for the loss of its operator, and the lease expires.
        """
        self.owner = None
        self._takeover_allowed = True


def held_by(system: int) -> Answered:
    """Return the refusal of a client that is not in control."""
    return Answered(Refused(Reason.LEASE_HELD, 0, f"MAVLink {system}"))
