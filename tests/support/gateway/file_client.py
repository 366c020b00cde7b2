"""pymavlink's FTP client on a bench, in simulated time, perhaps over a line that loses frames."""

from collections import deque
from collections.abc import Iterable
from random import Random
from types import SimpleNamespace
from typing import Any

import pytest
from pymavlink import mavftp

from gateways.mavlink.ftp_messages import HEADER, Opcode
from gateways.mavlink.mav_service import Sender
from gateways.mavlink.mavlink_dialect import MavMessage, mavlink
from tests.support.gateway.fake_port import CLIENT
from tests.support.gateway.parameter_bench import ParameterBench, of_type

EPOCH_S = 1_000_000.0
ROUND_S = 0.02


class SimulatedLink:
    """The connection of a client to a bench; `loss` is the share of lost frames, each way."""

    def __init__(self, bench: ParameterBench, loss: float = 0.0, seed: int = 1) -> None:
        self.bench = bench
        self.source_system, self.source_component = CLIENT.system, CLIENT.component
        self.mav = self
        self._random = Random(seed)
        self._loss = loss
        self._looks = 0
        self._inbox: deque[MavMessage] = deque()

    def time(self) -> float:
        """Return the simulated time; each look at the clock takes a microsecond."""
        self._looks += 1
        return EPOCH_S + self.bench.now_ns / 1e9 + self._looks * 1e-6

    def send(self, message: MavMessage) -> None:
        """Send a message to the vehicle."""
        if self._random.random() >= self._loss:
            self._receive(self.bench.send(message))

    def file_transfer_protocol_send(
        self, network: int, system: int, component: int, payload: bytes
    ) -> None:
        """Send a request, as pymavlink's client does."""
        self.send(
            mavlink.MAVLink_file_transfer_protocol_message(
                network, system, component, list(payload)
            )
        )

    def recv_match(self, type: Any = None, blocking: bool = False, timeout: float = 0) -> Any:
        """Return the next message of these types, or None after the time."""
        types = [type] if isinstance(type, str) else type
        end_s = self.time() + timeout
        while True:
            while self._inbox:
                found = self._inbox.popleft()
                if types is None or found.get_type() in types:
                    return found
            if self.time() >= end_s:
                return None
            self._receive(self.bench.after(ROUND_S))

    def _receive(self, messages: Iterable[MavMessage]) -> None:
        self._inbox.extend(one for one in messages if self._random.random() >= self._loss)


def client_on(
    link: SimulatedLink, monkeypatch: pytest.MonkeyPatch, block: int = 80
) -> mavftp.MAVFTP:
    """Return pymavlink's client, which lives in the bench's time."""
    monkeypatch.setattr(mavftp, "time", SimpleNamespace(time=link.time, sleep=lambda _: None))
    client = mavftp.MAVFTP(link, 1, 1)
    client.ftp_settings.burst_read_size = block
    return client


class Reply:
    """The parts of a reply."""

    def __init__(self, message: MavMessage) -> None:
        payload = bytes(message.payload)
        self.target = (message.target_system, message.target_component)
        head = HEADER.unpack_from(payload)
        self.sequence, self.session, self.opcode, size, self.request, last, self.offset = head
        self.is_last = bool(last)
        self.data = payload[HEADER.size : HEADER.size + size]


def asked(
    opcode: int,
    data: bytes = b"",
    *,
    session: int = 0,
    offset: int = 0,
    size: int | None = None,
    sequence: int = 0,
) -> MavMessage:
    """Return a request."""
    length = len(data) if size is None else size
    head = HEADER.pack(sequence & 0xFFFF, session, opcode, length, 0, 0, offset)
    payload = list((head + data).ljust(251, b"\0"))
    return mavlink.MAVLink_file_transfer_protocol_message(0, 1, 1, payload)


def replies(bench: ParameterBench, message: MavMessage, sender: Sender = CLIENT) -> list[Reply]:
    """Send a request; return the replies of the next half second."""
    return replies_in(bench.send(message, sender) + bench.after(0.5))


def replies_in(messages: Iterable[MavMessage]) -> list[Reply]:
    """Return the replies among messages."""
    return [Reply(one) for one in of_type(list(messages), "FILE_TRANSFER_PROTOCOL")]


def failure(found: list[Reply]) -> int:
    """Return the reason in the only reply, which is a NAK."""
    (reply,) = found
    assert reply.opcode == Opcode.NAK
    assert len(reply.data) == 1
    return reply.data[0]
