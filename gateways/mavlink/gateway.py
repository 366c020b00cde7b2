"""The process: pass messages of clients to vehicles, and send their answers, on one event loop.

Bytes are processed as they arrive; streams, retries and time-outs in rounds. Nothing waits in
between. Once a second it reports the totals of its clients on the bus.
"""

import asyncio
import time
from collections.abc import Iterable, Sequence
from functools import partial
from typing import Any, Final, NamedTuple

from gateways.mavlink.bus_port import BusPort
from gateways.mavlink.clients import ClientLink, Clients, GatewayClient
from gateways.mavlink.endpoints import Arrival, Endpoint
from gateways.mavlink.framing import MavFrame, is_emergency_stop
from gateways.mavlink.mav_service import NEWCOMER, WATCHER, Sender
from gateways.mavlink.mav_vehicle import Face, Work
from gateways.mavlink.mavlink_dialect import MavMessage, mavlink
from gateways.mavlink.operator_control import Owner
from gateways.mavlink.signing import DOUBTS, Rights, SignatureVerdict, SigningGuard
from gateways.mavlink.traffic_recorder import TrafficRecorder
from protocol.wire.enums import Severity
from protocol.wire.messages import GatewayStatus
from runtime.clock import Clock
from runtime.units import NS_PER_MS, NS_PER_S, UINT32

PERIOD_NS: Final = NS_PER_S


class Totals(NamedTuple):
    """Counters of all clients, including those that have disconnected."""

    received: int = 0
    lost: int = 0
    malformed: int = 0
    refused: int = 0


class Reporter:
    """Counts the traffic of all vehicles, and reports it for each one."""

    def __init__(self, now_ns: int) -> None:
        self._due_ns = self._since_ns = now_ns
        self._gone = Totals()
        self._before = Totals()
        self._sent_bytes: dict[int, int] = {}

    def sent(self, system: int, size: int) -> None:
        """Count a frame of a vehicle."""
        self._sent_bytes[system] = self._sent_bytes.get(system, 0) + size

    def left(self, link: ClientLink) -> None:
        """Keep the counters of a client that has disconnected."""
        self._gone = _sum(self._gone, _totals(link))

    def is_due(self, now_ns: int) -> bool:
        """Return whether a second is over."""
        return now_ns >= self._due_ns

    def take(
        self, links: Iterable[ClientLink], owners: dict[int, Owner | None], now_ns: int
    ) -> list[GatewayStatus]:
        """Return the state of each vehicle, by its system id, since the last call."""
        links = list(links)
        seconds = max(now_ns - self._since_ns, 1) / NS_PER_S
        totals = self._gone
        for link in links:
            totals = _sum(totals, _totals(link))
        received = totals.received - self._before.received
        lost = max(0, totals.lost - self._before.lost)  # overtaken frames are subtracted later
        found = [
            GatewayStatus(
                time_ns=0,
                sent_bytes_s=min(UINT32, round(self._sent_bytes.get(system, 0) / seconds)),
                refused=totals.refused & UINT32,
                malformed=totals.malformed & UINT32,
                received_hz=min(0xFFFF, round(received / seconds)),
                lost_permille=round(1000 * lost / max(1, lost + received)),
                system=system,
                clients=min(0xFF, len(links)),
                signing=min(0xFF, sum(1 for link in links if link.signing.signed)),
                owner=0 if owner is None else owner.system,
            )
            for system, owner in owners.items()
        ]
        self._before, self._sent_bytes = totals, {}
        self._since_ns, self._due_ns = now_ns, now_ns + PERIOD_NS
        return found


def _totals(link: ClientLink) -> Totals:
    return Totals(link.received, link.lost, link.malformed, link.signing.refused)


def _sum(one: Totals, other: Totals) -> Totals:
    return Totals(*(a + b for a, b in zip(one, other, strict=True)))


CALM_NS: Final = 100 * NS_PER_MS
"""Time between two rounds that only send streams of 10 Hz and less."""
STREAMS_NS: Final = 50 * NS_PER_MS
"""The same for faster streams: the robot sends telemetry at 20 Hz."""
BUSY_NS: Final = 20 * NS_PER_MS
"""Time between two rounds while clients send or receive more than heartbeats and streams."""
BUSY_FOR_NS: Final = 2 * NS_PER_S
STALL_NS: Final = 2 * NS_PER_S
"""Without a round for so long, this process was stopped: what clients sent meanwhile is too old."""
QUIET_TURNS: Final = 8
"""Turns of the event loop without any input after which the buffers are empty. A connection is read
some turns after it is accepted."""
MAX_OLD_TURNS: Final = 1000
"""Turns for which input counts as old, at most: buffers hold less, but a flood never ends."""
FINISH_NS: Final = 500 * NS_PER_MS
"""Time for the answers that are due when the gateway ends."""
FINISH_STEP_S: Final = 0.02


CALM: Final = frozenset(
    {
        mavlink.MAVLINK_MSG_ID_HEARTBEAT,
        mavlink.MAVLINK_MSG_ID_PING,
        mavlink.MAVLINK_MSG_ID_TIMESYNC,
        mavlink.MAVLINK_MSG_ID_SYSTEM_TIME,
        mavlink.MAVLINK_MSG_ID_RADIO_STATUS,
        mavlink.MAVLINK_MSG_ID_STATUSTEXT,
    }
)
"""Messages that clients and radios repeat for hours, or that are done with once they are sent."""


class Pace:
    """The time of the next round."""

    def __init__(self, now_ns: int) -> None:
        self.due_ns = self._busy_until_ns = now_ns

    def note(self, number: int, now_ns: int) -> None:
        """Record the id of a message from a client, or of one to it that is no stream."""
        if number not in CALM:
            self._busy_until_ns = now_ns + BUSY_FOR_NS
            self.due_ns = min(self.due_ns, now_ns + BUSY_NS)

    def is_due(self, now_ns: int, shortest_ns: int = CALM_NS) -> bool:
        """Return whether a round is due; then plan the next. Missed rounds are skipped.

        `shortest_ns` is the shortest time between two messages of a stream.
        """
        if now_ns < self.due_ns:
            return False
        calm_ns = CALM_NS if shortest_ns >= CALM_NS else STREAMS_NS
        period_ns = BUSY_NS if now_ns < self._busy_until_ns else calm_ns
        self.due_ns = max(self.due_ns + period_ns, now_ns)
        return True


class Gateway:
    """The clients of all endpoints, and the vehicles that are presented to them.

    `line_bytes_s` limits the rate to each client, in addition to the limit of its line.
    """

    def __init__(
        self,
        endpoints: Sequence[Endpoint],
        faces: Sequence[Face],
        ports: Sequence[BusPort],
        clock: Clock,
        recorder: TrafficRecorder | None = None,
        guard: SigningGuard | None = None,
    ) -> None:
        self.clients = Clients(self._join, self._leave, self._is_owner)
        self.line_bytes_s: int | None = None
        self._endpoints = tuple(endpoints)
        self._faces = tuple(faces)
        self._ports = tuple(ports)
        self._clock = clock
        self._recorder = recorder
        self._guard = guard or SigningGuard(time.time_ns)
        self._pace = Pace(clock.now_ns())
        self._reporter = Reporter(clock.now_ns())
        self._awake_ns = clock.now_ns()
        self._is_old = False
        self._quiet_turns = 0
        self._timer: asyncio.TimerHandle | None = None
        self._timer_ns = 0
        self._tasks: set[asyncio.Task[None]] = set()

    async def serve(self) -> None:
        """Serve clients until this is cancelled, or raise the first error of a callback."""
        loop = self._loop = asyncio.get_running_loop()
        failure = loop.create_future()

        def fail(_: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
            if "socket" in context:  # nothing is left to accept a connection: asyncio tries again
                return
            if not failure.done():
                failure.set_exception(context.get("exception") or RuntimeError(context["message"]))

        def end(task: asyncio.Task[None]) -> None:
            self._tasks.discard(task)
            if not task.cancelled() and (error := task.exception()) is not None:
                fail(loop, {"exception": error})

        def go_on(work: Work) -> None:
            task = loop.create_task(work)
            self._tasks.add(task)
            task.add_done_callback(end)

        loop.set_exception_handler(fail)
        for face in self._faces:
            face.vehicle.go_on = go_on
            face.vehicle.outbox.filled = partial(loop.call_soon, self._send)
        for endpoint in self._endpoints:
            await endpoint.attach(self)
        self._round()
        await failure

    async def finish(self) -> None:
        """Serve until the clients have the answers to their requests, for FINISH_NS at most."""
        end_ns = self._clock.now_ns() + FINISH_NS
        self._plan_round()  # a signal may have interrupted one
        is_busy = True
        while is_busy and self._clock.now_ns() < end_ns:
            is_busy = any(port.is_busy for port in self._ports)
            await asyncio.sleep(FINISH_STEP_S)  # an answer follows the end of a request

    def close(self) -> None:
        """Close all endpoints."""
        if self._timer is not None:
            self._timer.cancel()
        for endpoint in self._endpoints:
            endpoint.close()

    def connected(self, endpoint: Endpoint, peer: str) -> None:
        """Add a peer that stays while it is silent."""
        self._quiet_turns = 0
        self.clients.connect(endpoint, peer, self._clock.now_ns())

    def disconnected(self, endpoint: Endpoint, peer: str) -> None:
        """Drop a peer whose connection has ended."""
        self.clients.disconnect(endpoint, peer)

    def received(self, endpoint: Endpoint, arrived: Sequence[Arrival]) -> None:
        """Process bytes of peers: their emergency stops are sent before this returns."""
        now_ns = self._awake()
        self._quiet_turns = 0
        for peer, data, is_loopback in arrived:
            self.clients.feed(endpoint, peer, data, now_ns, is_loopback=is_loopback)
        self._process(now_ns)
        self._plan_round()

    def _round(self) -> None:
        """Process streams, retries and time-outs, and what clients sent beyond their shares."""
        self._timer = None
        now_ns = self._awake()
        shortest_ns = min(face.vehicle.shortest_ns for face in self._faces)
        if self._pace.is_due(now_ns, shortest_ns):
            self.clients.begin_round(now_ns)
            self._process(now_ns)
            lossy = {client.link.number for client in self.clients if client.is_lossy}
            for face in self._faces:
                face.vehicle.lossy = lossy
                face.due(now_ns)
            self._report(now_ns)
        self._plan_round()

    def _plan_round(self) -> None:
        """Let the next round begin when it is due; what clients ask brings it forward."""
        due_ns = self._pace.due_ns
        if self._timer is not None and self._timer_ns != due_ns:
            self._timer.cancel()
            self._timer = None
        if self._timer is None:
            wait_s = (due_ns - self._clock.now_ns()) / NS_PER_S
            self._timer, self._timer_ns = self._loop.call_later(wait_s, self._round), due_ns

    def _awake(self) -> int:
        """Return the time; drop what clients sent while this process was stopped.

        Its senders have had no answer, and a robot that then drives surprises them. An emergency
        stop is taken all the same.
        """
        now_ns = self._clock.now_ns()
        silent_ns, self._awake_ns = now_ns - self._awake_ns, now_ns
        if silent_ns >= STALL_NS:
            self._quiet_turns, self._is_old = 0, True
            self._loop.call_soon(self._pass_old_turn, MAX_OLD_TURNS)
            self.clients.begin_round(now_ns)
            self._process(now_ns)
            seconds = silent_ns / NS_PER_S
            words = (
                f"the gateway stood still for {seconds:.1f} s: what you sent meanwhile was dropped"
            )
            for face in self._faces:
                face.vehicle.outbox.text(Severity.WARNING, words)
        return now_ns

    def _pass_old_turn(self, left: int) -> None:
        self._quiet_turns += 1
        self._is_old = left > 0 and self._quiet_turns < QUIET_TURNS
        if self._is_old:
            self._loop.call_soon(self._pass_old_turn, left - 1)

    def _process(self, now_ns: int) -> None:
        """Process the frames that have arrived; of old ones only emergency stops."""
        for client, frame in self.clients.frames(now_ns, is_limited=not self._is_old):
            if self._is_old:
                client.is_newcomer(frame)  # notes a HEARTBEAT
            if not self._is_old or is_emergency_stop(frame):
                self._dispatch(client, frame, now_ns)

    def _dispatch(self, client: GatewayClient, frame: MavFrame, now_ns: int) -> None:
        link, loopback = client.link, client.is_loopback
        rights, verdict = self._guard.check(
            frame, link.signing, client.endpoint.text, is_loopback=loopback
        )
        is_refused = rights is Rights.NONE or (
            rights is Rights.STOP and not is_emergency_stop(frame)
        )
        message = None if is_refused else link.decode(frame)
        if message is None:
            return
        self._pace.note(frame.number, now_ns)
        barred = WATCHER if rights is Rights.WATCH else ""
        if client.is_newcomer(frame):
            barred = barred or NEWCOMER
        is_signed, doubt = verdict is SignatureVerdict.VALID, DOUBTS.get(verdict, "")
        ids = link.number, frame.system, frame.component
        sender = Sender(*ids, barred, is_signed, loopback, doubt, link.is_mavlink1)
        if self._recorder is not None:
            self._recorder.received(message, now_ns)
        for face in self._faces:
            face.receive(message, sender, now_ns)

    def _join(self, client: GatewayClient) -> None:
        limits = [one for one in (self.line_bytes_s, client.endpoint.line_bytes_s) if one]
        for face in self._faces:
            share = min(limits) // len(self._faces) if limits else None
            face.join(client.link.number, share)

    def _leave(self, client: GatewayClient) -> None:
        self._reporter.left(client.link)
        for face in self._faces:
            face.forget(client.link.number)

    def _is_owner(self, client: GatewayClient) -> bool:
        owners = (face.vehicle.control.owner for face in self._faces)
        return any(owner and owner.client == client.link.number for owner in owners)

    def _report(self, now_ns: int) -> None:
        """Publish the state of the gateway once a second."""
        if self._reporter.is_due(now_ns):
            owners = {face.vehicle.system: face.vehicle.control.owner for face in self._faces}
            links = [client.link for client in self.clients]
            statuses = self._reporter.take(links, owners, now_ns)
            for port, status in zip(self._ports, statuses, strict=True):
                port.report(status)

    def _send(self) -> None:
        """Send what a turn of the event loop has put into the outboxes."""
        now_ns = self._clock.now_ns()
        for face in self._faces:
            recorded: set[int] = set()
            for message, number, is_stream in face.vehicle.outbox.take():
                self._send_one(face, message, number, now_ns, is_stream=is_stream)
                if self._recorder is not None and id(message) not in recorded:
                    recorded.add(id(message))  # clients may share a message of this round
                    self._recorder.sent(face.vehicle.system, message, now_ns)
        self._plan_round()

    def _send_one(
        self,
        face: Face,
        message: MavMessage,
        number: int | None,
        now_ns: int,
        *,
        is_stream: bool,
    ) -> None:
        if not is_stream:
            self._pace.note(message.get_msgId(), now_ns)
        for client in self.clients.addressed(number):
            frame = client.link.encode(face.vehicle.system, message, self._guard)
            if frame:
                self._reporter.sent(face.vehicle.system, len(frame))
                client.endpoint.send(client.peer, frame, is_stream=is_stream)
