"""The loop with fake endpoints: clients come and go, and no flood holds up a round."""

from collections.abc import Iterator

import pytest

from ground.gateway.clients.client_link import GONE_NS
from ground.gateway.clients.client_table import FRAMES_PER_ROUND, Client, Clients
from ground.gateway.endpoints.endpoint import Received
from tests.unit.ground.gateway.clients.test_framing import packed


class FakeEndpoint:
    text, line_bytes_s = "fake", None

    def __init__(self) -> None:
        self.connected: list[str] = []
        self.ended: list[str] = []
        self.forgotten: list[str] = []

    def filenos(self) -> list[int]:
        return []

    def lasting(self) -> list[str]:
        return self.connected

    def gone(self) -> list[str]:
        ended, self.ended = self.ended, []
        return ended

    def receive(self) -> list[Received]:
        return []

    def send(self, peer: str, data: bytes, *, is_stream: bool) -> None: ...

    def flush(self, now_ns: int) -> None: ...

    def forget(self, peer: str) -> None:
        self.forgotten.append(peer)

    def close(self) -> None: ...


class Room:
    def __init__(self) -> None:
        self.endpoint = FakeEndpoint()
        self.log: list[tuple[str, int]] = []
        self.clients = Clients([self.endpoint], self._note("join"), self._note("leave"))

    def _note(self, word: str) -> "Note":
        return Note(self.log, word)

    def feed(self, peer: str, data: bytes, now_ns: int = 0) -> None:
        self.clients.feed(self.endpoint, Received(peer, data, True), now_ns)

    def frames(self, now_ns: int = 0) -> Iterator[Client]:
        for client, _ in self.clients.frames(now_ns):
            yield client


class Note:
    def __init__(self, log: list[tuple[str, int]], word: str) -> None:
        self._log, self._word = log, word

    def __call__(self, client: Client) -> None:
        self._log.append((self._word, client.link.number))


@pytest.fixture
def room() -> Room:
    return Room()


def test_sender_of_a_frame_becomes_a_client(room: Room) -> None:
    room.feed("a", packed())
    room.feed("b", packed(mavlink1=True))
    assert room.log == [("join", 1), ("join", 2)]
    assert [client.peer for client in room.frames()] == ["a", "b"]


def test_sender_of_rubbish_takes_no_place(room: Room) -> None:
    room.feed("a", b"\xfd rubbish" * 9)
    assert room.log == []
    assert room.endpoint.forgotten == ["a"]


def test_silent_sender_is_dropped_but_not_a_connection(room: Room) -> None:
    room.endpoint.connected.append("line")
    room.clients.begin_round(0)
    room.feed("a", packed())
    assert len(list(room.frames())) == 1
    room.clients.begin_round(GONE_NS - 1)
    assert room.log == [("join", 1), ("join", 2)]
    room.clients.begin_round(GONE_NS)
    assert room.log[2:] == [("leave", 2)]
    room.endpoint.connected.clear()
    room.endpoint.ended.append("line")
    room.clients.begin_round(GONE_NS)
    assert room.log[3:] == [("leave", 1)]


def test_flood_of_one_client_leaves_others_their_share(room: Room) -> None:
    room.feed("a", packed())
    room.feed("b", packed())
    list(room.frames())
    room.feed("a", packed() * 10_000)
    room.feed("b", packed())
    room.clients.begin_round(1)
    peers = [client.peer for client in room.frames(1)]
    assert peers.count("b") == 1
    assert peers.count("a") <= FRAMES_PER_ROUND // 2
    assert next(iter(room.clients)).link.dropped > 0
