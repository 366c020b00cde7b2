"""Each stream arrives complete from its first sample, even if Zenoh fetched and dropped some."""

from threading import Event
from types import SimpleNamespace
from typing import cast

import pytest
import zenoh

from protocol.bus.late_join import FETCHED, FETCHES, LIVE, SOURCES, LateJoin, Source
from tests.support.until import PATIENCE_S, until


def sample(number: int, sender: str = "a", *, live: bool = True) -> zenoh.Sample:
    """Return a numbered sample of `sender`, either live or fetched."""
    info = SimpleNamespace(source_id=SimpleNamespace(zid=sender, eid=7), source_sn=number)
    how = LIVE if live else FETCHED
    return cast(zenoh.Sample, SimpleNamespace(source_info=info, congestion_control=how))


class Following:
    """A sender has kept five samples, and gives them out once it is `let`."""

    def __init__(self) -> None:
        self.heard: list[tuple[str, int]] = []
        self.asked: list[Source] = []
        self.let = Event()
        self.whole = LateJoin(self._fetch, self._take)

    def _fetch(self, source: Source) -> list[zenoh.Sample]:
        self.asked.append(source)
        assert self.let.wait(PATIENCE_S)
        return [sample(number, source[0], live=False) for number in (4, 2, 0, 1, 3)]

    def _take(self, found: zenoh.Sample) -> None:
        info = found.source_info
        assert info is not None
        self.heard.append((str(info.source_id.zid), info.source_sn))


def test_fetched_samples_precede_the_first_live_sample() -> None:
    following = Following()
    for number in (3, 4, 5):
        following.whole.receive(sample(number))
    following.whole.receive(sample(0, "b"))
    assert following.heard == [("b", 0)], "another sender does not wait"
    following.let.set()
    until(lambda: len(following.heard) == 7)
    following.whole.receive(sample(6))
    assert following.heard == [("b", 0), *(("a", number) for number in range(7))]
    assert following.asked == [("a", 7)]


@pytest.mark.parametrize("first", [sample(0), sample(3, live=False)])
def test_complete_stream_is_not_fetched(first: zenoh.Sample) -> None:
    following = Following()
    following.whole.receive(first)
    following.whole.receive(sample(4))
    assert [number for _, number in following.heard][1:] == [4]
    assert not following.asked


def test_invented_senders_use_bounded_threads_and_memory() -> None:
    following = Following()
    for number in range(2 * SOURCES):
        following.whole.receive(sample(9, str(number)))
    assert len(following.heard) == 2 * SOURCES - FETCHES
    following.let.set()
    until(lambda: len(following.heard) == 2 * SOURCES + 5 * FETCHES)
    assert len(following.asked) == FETCHES
    assert len(following.whole._known) == SOURCES


def test_waiting_samples_are_delivered_if_the_fetch_fails() -> None:
    heard: list[zenoh.Sample] = []

    def fetch(_: Source) -> list[zenoh.Sample]:
        raise RuntimeError("as the test wants it")

    whole = LateJoin(fetch, heard.append)
    whole.receive(sample(3))
    until(lambda: len(heard) == 1)


def test_foreign_samples_are_delivered_unchanged() -> None:
    heard: list[zenoh.Sample] = []
    foreign = cast(zenoh.Sample, SimpleNamespace(source_info=None, congestion_control=LIVE))
    whole = LateJoin(lambda _: [], heard.append)
    whole.receive(foreign)
    whole.receive(foreign)
    assert len(heard) == 2
