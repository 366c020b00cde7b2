"""Each sender's events arrive from its first one on, each once and in order, whatever is lost."""

from functools import partial
from types import SimpleNamespace
from typing import cast

import zenoh

from protocol.bus.publisher import (
    FETCHED,
    FETCHES,
    LIVE,
    MAX_WAITING,
    SOURCES,
    Got,
    LateJoin,
    Source,
    source_in,
)

A = ("a", 7)


def sample(number: int, sender: str = "a", *, live: bool = True) -> zenoh.Sample:
    """Return a numbered sample of `sender`, either live or fetched."""
    info = SimpleNamespace(source_id=SimpleNamespace(zid=sender, eid=7), source_sn=number)
    how = LIVE if live else FETCHED
    return cast(zenoh.Sample, SimpleNamespace(source_info=info, congestion_control=how))


class Following:
    """A subscriber whose fetches are answered by `answer`, oldest first."""

    def __init__(self) -> None:
        self.heard: list[tuple[str, int]] = []
        self.asked: list[tuple[Source, int]] = []
        self._open: list[Got] = []
        self.late_join = LateJoin(self._fetch, self._take)

    def receive(self, *numbers: int, sender: str = "a") -> None:
        for number in numbers:
            self.late_join.receive(sample(number, sender))

    def answer(self, *numbers: int, sender: str = "a") -> None:
        self._open.pop(0)([sample(number, sender, live=False) for number in numbers])

    def _fetch(self, source: Source, due: int, got: Got) -> None:
        self.asked.append((source, due))
        self._open.append(got)

    def _take(self, found: zenoh.Sample) -> None:
        info = found.source_info
        assert info is not None
        self.heard.append((str(info.source_id.zid), info.source_sn))

    @property
    def numbers(self) -> list[int]:
        return [number for sender, number in self.heard if sender == "a"]


def test_fetched_samples_precede_the_first_live_sample() -> None:
    following = Following()
    following.receive(3, 4, 5)
    following.receive(0, sender="b")
    assert following.heard == [("b", 0)], "another sender does not wait"
    following.answer(4, 2, 0, 1, 3)
    following.receive(6)
    assert following.numbers == [0, 1, 2, 3, 4, 5, 6]
    assert following.asked == [(A, 0)]


def test_an_announced_sender_is_fetched_from_its_first_sample() -> None:
    following = Following()
    following.late_join.announced(A, 0)
    following.late_join.announced(A, 2)
    following.answer(0, 1, 2)
    following.late_join.announced(A, 2)
    assert following.numbers == [0, 1, 2]
    assert following.asked == [(A, 0)], "what has arrived is not fetched again"


def test_a_lost_newest_sample_is_fetched_when_announced() -> None:
    following = Following()
    following.receive(0, 1)
    following.late_join.announced(A, 3)
    following.answer(2, 3)
    following.receive(3, 4)
    assert following.numbers == [0, 1, 2, 3, 4]
    assert following.asked == [(A, 2)]


def test_a_sample_lost_during_a_fetch_is_fetched_too() -> None:
    following = Following()
    following.receive(2, 5)
    following.answer(0, 1, 2, 3)
    assert following.numbers == [0, 1, 2, 3]
    following.answer(4, 5)
    assert following.numbers == [0, 1, 2, 3, 4, 5]
    assert following.asked == [(A, 0), (A, 4)]


def test_samples_that_the_sender_no_longer_has_are_left_out() -> None:
    following = Following()
    following.receive(0, 900)
    following.answer(800, 801, 900)
    assert following.numbers == [0, 800, 801], "802 to 899 may come yet"
    following.answer()
    following.receive(901)
    assert following.numbers == [0, 800, 801, 900, 901]


def test_waiting_samples_are_delivered_without_an_answer() -> None:
    following = Following()
    following.receive(3, 7)
    following.answer()
    assert following.numbers == [3, 7]
    assert following.asked == [(A, 0)]


def test_an_answer_with_the_samples_of_another_sender_is_ignored() -> None:
    following = Following()
    following.receive(1)
    following.answer(0, sender="b")
    assert following.heard == [("a", 1)]


def test_complete_stream_is_not_fetched() -> None:
    following = Following()
    following.receive(0, 1, 1, 0, 2)
    assert following.numbers == [0, 1, 2]
    assert not following.asked


def test_invented_senders_use_bounded_fetches_and_memory() -> None:
    following = Following()
    for number in range(2 * SOURCES):
        following.receive(9, sender=str(number))
    assert len(following.heard) == 2 * SOURCES - FETCHES
    assert len(following.asked) == FETCHES
    assert len(following.late_join._senders) == SOURCES
    for number in range(FETCHES):
        following.answer(8, sender=str(number))
    assert len(following.heard) == 2 * SOURCES + FETCHES
    following.late_join.announced(("0", 7), 12)
    assert following.asked[-1] == (("0", 7), 10), "there is room for fetches again"


def test_few_samples_wait_for_an_answer() -> None:
    following = Following()
    following.receive(*range(1, 2 * MAX_WAITING))
    following.answer(0)
    assert following.numbers == list(range(MAX_WAITING + 1))


def test_foreign_samples_are_delivered_unchanged() -> None:
    heard: list[zenoh.Sample] = []
    foreign = cast(zenoh.Sample, SimpleNamespace(source_info=None, congestion_control=LIVE))
    late_join = LateJoin(lambda *_: None, heard.append)
    late_join.receive(foreign)
    late_join.receive(foreign)
    assert len(heard) == 2


def test_only_the_key_of_a_sender_names_one() -> None:
    named = partial("sidestep/r1/tlm/text/@adv/pub/{}/{}/_".format, "ab12")
    assert source_in(named(7)) == ("ab12", 7)
    assert source_in(named("uhlc")) is source_in(named("9" * 5000)) is None
