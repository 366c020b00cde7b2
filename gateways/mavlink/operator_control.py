"""Operator control: one client of the gateway at a time holds the robot's lease.

The first state-changing command takes the lease if it is free. The gateway sends the operator's
heartbeat to the robot while frames of the client in control arrive. Without them, the robot reacts
as to the loss of any operator. An emergency stop needs no control, and neither does a command that
only stops. Control passes from client to client of the gateway under the same lease.

Any frame of the client in control tells that it is there, and PING asks for one. QGroundControl and
MAVSDK answer PING. MAVProxy and most scripts answer nothing, and send one HEARTBEAT a second.
"""

import asyncio
from collections.abc import Awaitable, Callable, Collection
from functools import partial
from typing import Any, Final, NamedTuple

from gateways.mavlink.mav_service import Outbox, Sender
from gateways.mavlink.mavlink_dialect import mavlink
from gateways.mavlink.robot_port import (
    KEEPS_FENCE,
    OVERTAKEN,
    STOPS,
    Answered,
    RobotPort,
    Snapshot,
    permitted,
)
from ground.client.lease_holder import is_ours
from ground.client.missions import TransferOutcome
from ground.client.outcomes import Accepted, Operation, Outcome, Refused
from ground.client.requests import CROSSING_NS, HeartbeatTimer
from ground.commands.fence import ClearFence
from protocol.wire.enums import LeaseAction, Severity
from protocol.wire.limits import OPERATOR_LOST_MS
from protocol.wire.reasons import Reason
from runtime.units import NS_PER_MS, NS_PER_S, NS_PER_US

SILENCE_NS: Final = 3_500 * NS_PER_MS
"""Without a frame of the client for so long, the robot gets no heartbeat of its operator any more.
It misses it 1.5 s later, so that both together are the 5 s of ArduPilot's FS_GCS_TIMEOUT."""
PATIENCE_NS: Final = 7_000 * NS_PER_MS
"""The same on a line that loses frames, for a client that answers no PING. If a fifth of its
heartbeats is lost, four in a row are lost five times in an hour, and eight once in a week."""
LOST_NS: Final = OPERATOR_LOST_MS * NS_PER_MS
"""A client that is heard again within this time stays in control: the robot has not missed it."""
QUIET_NS: Final = 1_200 * NS_PER_MS
"""After this silence, longer than the time between two heartbeats, the client is asked by PING."""
ASK_NS: Final = 200 * NS_PER_MS
MAX_QUESTIONS: Final = 5
"""So often a new client in control is asked once a second, to learn whether it answers."""


class ClientPresence:
    """What was heard of a client, `station`, since it took control."""

    def __init__(self, station: Sender, now_ns: int) -> None:
        self.station = station
        self.heard_ns = now_ns
        self._answers = False
        self._asked_ns = now_ns - NS_PER_S
        self.questions = 0

    def heard(self, now_ns: int) -> None:
        """Note a frame."""
        self.heard_ns = now_ns

    def answered(self) -> None:
        """Note an answer to PING."""
        self._answers = True

    def silent_ns(self, now_ns: int) -> int:
        """Return the time since the last frame."""
        return now_ns - self.heard_ns

    def limit_ns(self, *, is_lossy: bool) -> int:
        """Return the silence after which the client counts as gone, by the state of its line."""
        return PATIENCE_NS if is_lossy and not self._answers else SILENCE_NS

    def must_ask(self, now_ns: int, *, is_doubted: bool) -> bool:
        """Return whether to send a PING now; `is_doubted`: another one claims to be this client."""
        is_quiet = is_doubted or self.silent_ns(now_ns) >= QUIET_NS
        is_new = not self._answers and self.questions < MAX_QUESTIONS
        every_ns = ASK_NS if is_quiet else NS_PER_S
        if not (is_quiet or is_new) or now_ns - self._asked_ns < every_ns:
            return False
        self._asked_ns = now_ns
        self.questions += 1
        return True


GONE_NS: Final = 1_100 * NS_PER_MS
RETURN_NS: Final = 700 * NS_PER_MS
"""A client that comes back with the same ids from another address gets control once the old address
has been silent for GONE_NS, or for RETURN_NS since the request, in which it is asked by PING four
times. Row 64 of the judge gives the gateway a second, in which a busy computer takes its part."""
MAX_TAKING: Final = 64
"""Requests for control that wait for the robot; more are refused."""
BUSY: Final = "too many requests for control at once"
SAME_IDS: Final = (
    "the same ids {0}/{1} are in control from another address: give each ground station ids of its"
    f" own; after a restart wait {SILENCE_NS / NS_PER_S:g} s, or sign"
)
ANYONE: Final = 0
"""The target of a PING that asks for an answer."""


GATEWAY_NAME: Final = "MAVLink "
"""The names of clients for other operators begin so."""


IsEarly = Callable[[Answered], Awaitable[bool]]


class Owner(NamedTuple):
    """The client in control: a peer, and the system id that it uses."""

    client: int
    system: int


def has_refused(outcome: Outcome | None) -> bool:
    """Return whether the robot has refused, so that nothing is in force."""
    if isinstance(outcome, TransferOutcome):
        return not (outcome.ok or outcome.verdict.in_force)
    return isinstance(outcome, Refused)


class OperatorControl:
    """Keep the owner, take and release the lease, and send the operator's heartbeat."""

    def __init__(self, port: RobotPort, outbox: Outbox, keeps_fence: Callable[[], bool]) -> None:
        self._presence: ClientPresence | None = None
        self._is_there = False
        self._takeover_allowed = True
        self._port = port
        self._outbox = outbox
        self._keeps_fence = keeps_fence
        self._snapshot: Snapshot | None = None
        self._now_ns = self._changed_ns = 0
        self._taking: list[asyncio.Future[tuple[Sender, Answered]]] | None = None
        self._returning: list[tuple[Sender, asyncio.Future[Answered | None]]] = []
        self._returning_ns = 0
        self._heartbeat = HeartbeatTimer()
        self._stopping = 0
        self.stops = 0
        """How often clients have asked the robot to stop, without an emergency stop."""
        self.serial = 0
        """Counts what clients have made the robot do, and changes of control."""

    @property
    def owner(self) -> Owner | None:
        """The client in control, if it is there."""
        station = None if self._presence is None else self._presence.station
        return Owner(station.client, station.system) if station and self._is_there else None

    @property
    def is_foreign(self) -> bool:
        """True if an operator on the bus, such as one in the app, holds the lease."""
        lease = None if self._snapshot is None else self._snapshot.lease
        return lease is not None and bool(lease.held) and not is_ours(lease, self._port.identity)

    @property
    def takeover_allowed(self) -> bool:
        """True if a request for control is granted without asking the owner."""
        return not self.is_foreign if self.owner is None else self._takeover_allowed

    def holds(self, sender: Sender) -> bool:
        """Return whether the sender is in control."""
        return self.owner == Owner(sender.client, sender.system)

    def heard(self, sender: Sender, now_ns: int) -> None:
        """Record the time of a message of a client; its owner that was silent is there again."""
        self._now_ns = now_ns
        presence = self._presence
        if presence is not None and is_same_client(presence.station, sender):
            presence.heard(now_ns)
            self._is_there = True

    def answered(self, sender: Sender) -> None:
        """Note an answer to PING."""
        if self._presence is not None and self.holds(sender):
            self._presence.answered()

    async def perform(
        self, sender: Sender, operation: Operation[Any], is_early: IsEarly | None = None
    ) -> Answered:
        """Perform an operation, and return its end.

        Take control first if it moves the robot and no client has control; give it back if the
        robot refuses. While `is_early`, which waits, returns True for the answer, the same is asked
        again. An armed robot keeps its fence, which may be replaced but not removed: no single
        message, perhaps a forged one, makes it drive on without.
        """
        if not sender.may_command:
            return Answered(None, sender.barred)
        if isinstance(operation, ClearFence) and self._keeps_fence():
            return self.refusal(sender) or Answered(None, KEEPS_FENCE)
        lease = None if self._snapshot is None else self._snapshot.lease
        was_free, had_owner = lease is not None and not lease.held, self.owner is not None
        is_taken = operation.moves and not self.holds(sender)
        if is_taken:
            stops, granted = self.stops, await self.ensure(sender)
            if not granted.ok:
                return granted
            if self.stops != stops:
                return Answered(None, OVERTAKEN)
        self.serial += operation.moves
        serial, is_stop = self.serial, isinstance(operation, STOPS)
        self.stops += is_stop
        self._stopping += is_stop
        stops, name = self.stops, name_of(sender)
        # Another client may get control while the operation waits for its turn.
        refusal = partial(self._refused, sender) if operation.moves else permitted
        try:
            answered = await self._port.perform(operation, name, refusal)
            while is_early is not None and await is_early(answered):
                if self.stops != stops:
                    answered = Answered(None, OVERTAKEN)
                if self.stops != stops or not self.holds(sender):
                    break
                answered = await self._port.perform(operation, name, refusal)
        finally:
            self._stopping -= is_stop
        is_refused = has_refused(answered.outcome) and self.serial == serial
        if is_taken and is_refused and not had_owner and self.holds(sender):
            self._lose()
            if was_free:
                await self._port.change_lease(LeaseAction.RELEASE, name)
        return answered

    @property
    def is_stopping(self) -> bool:
        """True while the robot has not answered a request to stop."""
        return self._stopping > 0

    def refusal(self, sender: Sender) -> Answered | None:
        """Return why the sender cannot have control because of another client; None if it can."""
        station = None if self.owner is None or self._presence is None else self._presence.station
        if station is None or self.holds(sender) or is_back(station, sender):
            return None
        return held_by(station, sender)

    def _refused(self, sender: Sender) -> Outcome | None:
        refusal = self.refusal(sender)
        return None if refusal is None else refusal.outcome

    def admission(self, sender: Sender) -> Answered:
        """Return whether the sender may ask for control, without taking it."""
        if not sender.may_command:
            return Answered(None, sender.barred)
        return self.refusal(sender) or Answered(Accepted(0))

    async def ensure(self, sender: Sender) -> Answered:
        """Give control to the sender if no other client has it, otherwise return the refusal.

        A client that has come back with the same ids from another address gets it as soon as the
        old address is silent.
        """
        while True:
            refusal = self.refusal(sender)
            if not sender.may_command:
                return Answered(None, sender.barred)
            if self.holds(sender):
                return Answered(Accepted(0))
            if refusal is not None:
                return refusal
            if self.owner is None:
                return await self._take(sender)
            if len(self._returning) >= MAX_TAKING:
                return Answered(None, BUSY)
            if not self._returning:
                self._returning_ns = self._now_ns
            decided: asyncio.Future[Answered | None] = asyncio.get_running_loop().create_future()
            self._returning.append((sender, decided))
            refusal = await decided
            if refusal is not None:
                return refusal

    async def request(self, sender: Sender, *, allow_takeover: bool) -> Answered:
        """Give control to the sender if that is permitted.

        Set whether others may take it over.
        """
        if self.owner is None or self.holds(sender) or not self.takeover_allowed:
            answered = await self.ensure(sender)
        elif not sender.may_command:
            return Answered(None, sender.barred)
        else:
            answered = await self._take(sender)
        if answered.ok and self.holds(sender):
            self._takeover_allowed = allow_takeover
        return answered

    async def release(self, sender: Sender) -> Answered:
        """Give back the lease if the sender is in control."""
        if self.holds(sender):
            self._lose()
            return await self._port.change_lease(LeaseAction.RELEASE, name_of(sender))
        if self._presence is None or self.owner is None:
            return Answered(Accepted(0, note=Reason.NO_LEASE))
        return held_by(self._presence.station, sender)

    async def _take(self, sender: Sender) -> Answered:
        """Take the lease for a client; those that ask meanwhile get the same answer."""
        if self._taking is None:
            self._taking = []
            answered = await self._port.change_lease(LeaseAction.TAKE, name_of(sender))
            waiting, self._taking = self._taking, None
            if answered.ok:
                self._give(sender)
                self._changed_ns = self._now_ns
                self._port.heartbeat()
            for taken in waiting:
                taken.set_result((sender, answered))
            return answered
        if len(self._taking) >= MAX_TAKING - 1:
            return Answered(None, BUSY)
        found: asyncio.Future[tuple[Sender, Answered]]
        found = asyncio.get_running_loop().create_future()
        self._taking.append(found)
        owner, answered = await found
        is_others = answered.ok and not self.holds(sender)
        return held_by(owner, sender) if is_others else answered

    def _give(self, sender: Sender) -> None:
        """Give control to a client, and tell the one that had it."""
        before = None if self._presence is None else self._presence.station
        if before is not None and before.client != sender.client:
            is_same = ids_of(before) == ids_of(sender)
            words = (
                "the same ids from another address have" if is_same else f"{name_of(sender)} has"
            )
            self._outbox.text(Severity.WARNING, f"{words} taken control", before.client)
        self._presence = ClientPresence(sender, self._now_ns)
        self._is_there = self._takeover_allowed = True
        self.serial += 1

    def due(self, snapshot: Snapshot, now_ns: int, lossy: Collection[int] = ()) -> None:
        """Follow the robot's lease status, and send the heartbeat while the owner is heard.

        `lossy` are the clients whose line loses frames.
        """
        self._now_ns, self._snapshot = now_ns, snapshot
        self._let_return(now_ns)
        presence = self._presence
        if presence is None:
            return
        station, silent_ns = presence.station, presence.silent_ns(now_ns)
        limit_ns = presence.limit_ns(is_lossy=station.client in lossy)
        self._is_there = silent_ns < limit_ns
        if silent_ns >= limit_ns + LOST_NS:
            words = f"{name_of(station)} was silent for {silent_ns / NS_PER_S:.1f} s"
            self._outbox.text(Severity.WARNING, f"{words}: it has lost control")
            self._lose()
            return
        lease = snapshot.lease
        is_lost = lease is not None and not is_ours(lease, self._port.identity)
        if is_lost and now_ns > self._changed_ns + CROSSING_NS:
            self._lose()
            return
        if presence.must_ask(now_ns, is_doubted=bool(self._returning)):
            fields = now_ns // NS_PER_US, presence.questions, ANYONE, ANYONE
            self._outbox.send(mavlink.MAVLink_ping_message(*fields), station.client)
        stamp_ns = 0 if snapshot.status is None else snapshot.status.time_ns
        if self._is_there and self._heartbeat.due(now_ns, stamp_ns):
            self._port.heartbeat()

    def _let_return(self, now_ns: int) -> None:
        """Give control to a client that has come back, or refuse it if the old address is alive."""
        waiting, presence, owner = self._returning, self._presence, None
        if not waiting:
            return
        if presence is not None and self.owner is not None:
            asked_ns = self._returning_ns
            if presence.heard_ns <= asked_ns:
                if presence.silent_ns(now_ns) < GONE_NS and now_ns - asked_ns < RETURN_NS:
                    return
                self._give(waiting[0][0])
            else:
                owner = presence.station
        self._returning = []
        for sender, decided in waiting:
            decided.set_result(None if owner is None else held_by(owner, sender))

    def forget(self, client: int) -> None:
        """Give up control if the client in control has disconnected."""
        if self._presence is not None and self._presence.station.client == client:
            self._lose()

    def _lose(self) -> None:
        """End the heartbeat.

        The robot then acts as configured for the loss of its operator, and the lease expires.
        """
        self._presence = None
        self._is_there, self._takeover_allowed = False, True
        self.serial += 1


def is_same_client(one: Sender, other: Sender) -> bool:
    """Return whether two messages come from one address and system id."""
    return (one.client, one.system) == (other.client, other.system)


def ids_of(sender: Sender) -> tuple[int, int]:
    """Return the MAVLink ids of a sender."""
    return sender.system, sender.component


def is_back(station: Sender, sender: Sender) -> bool:
    """Return whether the sender may be the station in control, at another address.

    A stranger on another computer can use its ids, but not sign.
    """
    is_local = station.is_loopback and sender.is_loopback
    return ids_of(station) == ids_of(sender) and (is_local or sender.is_signed)


def held_by(station: Sender, sender: Sender) -> Answered:
    """Return the refusal of a sender because another client, `station`, is in control."""
    if ids_of(station) == ids_of(sender):
        words = SAME_IDS.format(*ids_of(station))
        return Answered(Refused(Reason.LEASE_HELD, 0), words)
    which = f"/{station.component}" if station.system == sender.system else ""
    return Answered(Refused(Reason.LEASE_HELD, 0, f"{name_of(station)}{which}"))


def name_of(sender: Sender) -> str:
    """Return the name of a client for other operators."""
    return f"{GATEWAY_NAME}{sender.system}"
