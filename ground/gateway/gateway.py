"""The process: wait for clients and the bus, hand messages to vehicles, send what they answer."""

import os
import selectors
from collections.abc import Sequence
from contextlib import suppress
from math import inf
from typing import Final

from ground.gateway.bus_port import BusPort
from ground.gateway.client_link import GONE_NS, ClientLink
from ground.gateway.dialect import MavMessage, mavlink
from ground.gateway.endpoints.endpoint import Endpoint
from ground.gateway.endpoints.recorder import TrafficRecorder
from ground.gateway.endpoints.udp import UdpEndpoint
from ground.gateway.traffic import Sender
from ground.gateway.vehicle import Face
from runtime.clock import Clock
from runtime.units import NS_PER_MS, NS_PER_S

CALM_NS: Final = 50 * NS_PER_MS
"""Time between two rounds that only send streams: the robot's telemetry has 20 Hz."""
BUSY_NS: Final = 20 * NS_PER_MS
"""Time between two rounds while clients send more than heartbeats, for transfers and retries."""
BUSY_FOR_NS: Final = 2 * NS_PER_S


class Pace:
    """The time of the next round."""

    def __init__(self, now_ns: int) -> None:
        self.due_ns = self._busy_until_ns = now_ns

    def heard(self, number: int, now_ns: int) -> None:
        """Note the id of a message from a client."""
        if number != mavlink.MAVLINK_MSG_ID_HEARTBEAT:
            self._busy_until_ns = now_ns + BUSY_FOR_NS
            self.due_ns = min(self.due_ns, now_ns + BUSY_NS)

    def is_due(self, now_ns: int) -> bool:
        """Return whether a round is due; then plan the next. Missed rounds are skipped."""
        if now_ns < self.due_ns:
            return False
        period_ns = BUSY_NS if now_ns < self._busy_until_ns else CALM_NS
        self.due_ns = max(self.due_ns + period_ns, now_ns)
        return True


class WakeUp:
    """Ends the wait of the gateway's thread from another thread."""

    def __init__(self) -> None:
        self.reader, self._writer = os.pipe()
        os.set_blocking(self.reader, False)
        os.set_blocking(self._writer, False)

    def wake(self) -> None:
        """End the present or the next wait."""
        with suppress(BlockingIOError):
            os.write(self._writer, b"x")

    def clear(self) -> None:
        """Forget all calls of `wake`."""
        with suppress(BlockingIOError):
            while os.read(self.reader, 4096):
                pass

    def close(self) -> None:
        """Close the pipe."""
        os.close(self.reader)
        os.close(self._writer)


class Gateway:
    """The clients of all endpoints, and the vehicles that they see."""

    def __init__(
        self,
        endpoints: Sequence[Endpoint],
        faces: Sequence[Face],
        ports: Sequence[BusPort],
        clock: Clock,
        wake_up: WakeUp,
        recorder: TrafficRecorder | None = None,
    ) -> None:
        self.clients: dict[tuple[Endpoint, str], ClientLink] = {}
        self._endpoints = tuple(endpoints)
        self._faces = tuple(faces)
        self._ports = tuple(ports)
        self._clock = clock
        self._wake_up = wake_up
        self._recorder = recorder
        self._numbers = 0
        self._pace = Pace(clock.now_ns())
        self._selector = selectors.DefaultSelector()
        self._selector.register(wake_up.reader, selectors.EVENT_READ)
        for endpoint in self._endpoints:
            for descriptor in endpoint.filenos():
                self._selector.register(descriptor, selectors.EVENT_READ, endpoint)
            if isinstance(endpoint, UdpEndpoint) and endpoint.fixed_peer is not None:
                self._client(endpoint, endpoint.fixed_peer, is_loopback=False)

    def run(self) -> None:
        """Serve until an exception, such as a signal, ends it."""
        while True:
            self.round()

    def round(self, *, longest_s: float = inf) -> None:
        """Wait for traffic until a round is due, and process both."""
        wait_s = max(0.0, (self._pace.due_ns - self._clock.now_ns()) / NS_PER_S)
        ready = self._selector.select(min(wait_s, longest_s))
        now_ns = self._clock.now_ns()
        for key, _ in ready:
            if key.data is None:
                self._wake_up.clear()
            else:
                self._receive(key.data, now_ns)
        for port in self._ports:
            port.deliver()
        if self._pace.is_due(now_ns):
            self._forget_silent(now_ns)
            for face in self._faces:
                face.due(now_ns)
        self._flush()

    def close(self) -> None:
        """Close all endpoints."""
        for endpoint in self._endpoints:
            endpoint.close()
        self._selector.close()

    def _receive(self, endpoint: Endpoint, now_ns: int) -> None:
        for peer, data, is_loopback in endpoint.receive():
            client = self._client(endpoint, peer, is_loopback=is_loopback)
            for message in client.decode(data, now_ns):
                self._pace.heard(message.get_msgId(), now_ns)
                sender = Sender(
                    client.number,
                    message.get_srcSystem(),
                    message.get_srcComponent(),
                    is_loopback=is_loopback,
                )
                if self._recorder is not None:
                    self._recorder.received(message, now_ns)
                for face in self._faces:
                    face.receive(message, sender, now_ns)

    def _client(self, endpoint: Endpoint, peer: str, *, is_loopback: bool) -> ClientLink:
        found = self.clients.get((endpoint, peer))
        if found is None:
            self._numbers += 1
            now_ns = self._clock.now_ns()
            found = ClientLink(self._numbers, peer, now_ns, is_loopback=is_loopback)
            self.clients[endpoint, peer] = found
            for face in self._faces:
                face.join(found.number)
        return found

    def _forget_silent(self, now_ns: int) -> None:
        for (endpoint, peer), client in list(self.clients.items()):
            is_fixed = isinstance(endpoint, UdpEndpoint) and endpoint.fixed_peer == peer
            if now_ns - client.heard_ns >= GONE_NS and not is_fixed:
                del self.clients[endpoint, peer]
                for face in self._faces:
                    face.forget(client.number)

    def _flush(self) -> None:
        for face in self._faces:
            recorded: set[int] = set()
            for message, number in face.vehicle.outbox.take():
                self._send(face.vehicle.system, message, number)
                if self._recorder is not None and id(message) not in recorded:
                    recorded.add(id(message))  # clients may share a message of this round
                    self._recorder.sent(face.vehicle.system, message, self._clock.now_ns())

    def _send(self, system: int, message: MavMessage, number: int | None) -> None:
        for (endpoint, peer), client in self.clients.items():
            if number is None or number == client.number:
                endpoint.send(peer, client.encode(system, message))
