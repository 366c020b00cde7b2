"""The mailbox keeps the newest message; simulated faults of links lose and swap them."""

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from protocol.bus.link_faults import FaultyLink, LinkFaults, earliest
from protocol.bus.mailbox import MAX_SENDERS, Mailbox, Origin, Sample, opened, stamp_of
from protocol.bus.network import Network
from protocol.topics import DIALECT, ENCODING, ENCODING_FAMILY, TEXT, WHEELS
from protocol.wire.codec import Encoder
from protocol.wire.message import Message
from protocol.wire.messages import SonarScan, Statustext, WheelTicks
from runtime import config
from runtime.errors import ConfigError, RemoteError, UserError
from runtime.units import NS_PER_MS
from runtime.units import NS_PER_MS as MS
from tests.support.each import each

TICKS = WheelTicks(time_ns=1, seq=1, left=2, right=3, bumper=0, expired=0)
SCAN = SonarScan(time_ns=0, seq=0, range_mm=(0,) * 8, ping_age_us=(0,) * 8, valid=0, echo=0)


def sample(message: Message = TICKS, encoding: str = ENCODING) -> Sample:
    return Sample(encoding, Encoder(1, 1).encode(message))


def test_an_empty_mailbox_has_nothing() -> None:
    box = Mailbox(WHEELS)
    assert box.latest() is None
    assert box.fresh(0) is None
    assert box.received() == []
    assert (box.rejected, box.last_rejection) == (0, "")


def test_the_newest_message_is_kept_with_its_arrival() -> None:
    box = Mailbox(WHEELS)
    box.store(sample(), 10)
    newer = WheelTicks(time_ns=2, seq=2, left=4, right=5, bumper=0, expired=0)
    box.store(sample(newer), 20)
    assert box.latest() == (newer, 20)


def test_a_message_is_fresh_up_to_the_topics_limit_and_not_beyond() -> None:
    box = Mailbox(WHEELS)
    box.store(sample(), 1_000 * NS_PER_MS)
    assert box.fresh(1_150 * NS_PER_MS) == TICKS
    assert box.fresh(1_150 * NS_PER_MS + 1) is None


def test_an_event_never_gets_stale() -> None:
    assert TEXT.stale_after_ns == 0
    box = Mailbox(TEXT)
    box.store(sample(TEXT.messages[0](severity=6, text="started")), 0)
    assert box.fresh(10**18) is not None


def ticks_at(stamp_ns: int) -> Sample:
    return sample(WheelTicks(time_ns=stamp_ns, seq=1, left=0, right=0, bumper=0, expired=0))


def test_older_sample_is_ignored_while_the_newest_is_fresh() -> None:
    heard: list[int] = []
    box = Mailbox(WHEELS, heard.append, forward=True)
    box.store(ticks_at(500 * NS_PER_MS), 1_000 * NS_PER_MS)
    for late_ms in (1, 50, 150):
        box.store(ticks_at(450 * NS_PER_MS), (1_000 + late_ms) * NS_PER_MS)
    newest = box.latest()
    assert newest is not None
    assert (newest[0].time_ns, newest[1], heard) == (
        500 * NS_PER_MS,
        1_000 * NS_PER_MS,
        [1_000 * NS_PER_MS],
    )
    assert (box.rejected, box.last_rejection) == (3, "WheelTicks is older than the one before it")


def test_restarted_sender_is_accepted_after_enough_silence() -> None:
    box = Mailbox(WHEELS, forward=True)
    box.store(ticks_at(500 * NS_PER_MS), 1_000 * NS_PER_MS)
    box.store(ticks_at(50 * NS_PER_MS), 1_151 * NS_PER_MS)
    newest = box.latest()
    assert newest is not None
    assert (newest[0].time_ns, box.rejected) == (50 * NS_PER_MS, 0)


def test_mailbox_of_rewindable_time_accepts_older_stamps() -> None:
    box = Mailbox(WHEELS)
    for stamp_ms, arrived_ms in ((50_000, 1_000), (10, 1_001), (50_000, 1_002)):
        box.store(ticks_at(stamp_ms * NS_PER_MS), arrived_ms * NS_PER_MS)
        newest = box.latest()
        assert newest is not None
        assert (newest[0].time_ns, newest[1]) == (stamp_ms * NS_PER_MS, arrived_ms * NS_PER_MS)
    assert box.rejected == 0


@each("forward", [False, True])
def test_stamp_of_2_to_the_62_is_rejected(forward: bool) -> None:
    box = Mailbox(WHEELS, forward=forward)
    for stamp_ns in (2**62, 2**63, 2**64 - 1):
        box.store(ticks_at(stamp_ns), 10)
        assert box.last_rejection == "WheelTicks has an invalid time stamp"
    assert (box.latest(), box.rejected) == (None, 3)
    box.store(ticks_at(2**62 - 1), 10)
    assert (box.latest() is not None, box.rejected) == (True, 3)


def test_stamp_may_be_at_most_ten_seconds_ahead_of_the_last() -> None:
    box = Mailbox(WHEELS, forward=True)
    box.store(ticks_at(5_000 * NS_PER_MS), 1_000 * NS_PER_MS)
    box.store(ticks_at(15_000 * NS_PER_MS), 1_050 * NS_PER_MS)
    assert box.latest() is not None
    assert box.rejected == 0
    box.store(ticks_at(25_000 * NS_PER_MS + 1), 1_100 * NS_PER_MS)
    words = "WheelTicks is far ahead of the one before it"
    assert (box.rejected, box.last_rejection) == (1, words)
    box.store(ticks_at(25_000 * NS_PER_MS + 1), 1_050 * NS_PER_MS + WHEELS.stale_after_ns + 1)
    newest = box.latest()
    assert newest is not None
    assert newest[0].time_ns == 25_000 * NS_PER_MS + 1, "the one before was no longer fresh"


def test_messages_without_a_stamp_are_never_out_of_order() -> None:
    assert stamp_of(TEXT.messages[0](severity=6, text="started")) == 0
    box = Mailbox(TEXT, forward=True)
    for _ in range(2):
        box.store(sample(TEXT.messages[0](severity=6, text="started")), 0)
    assert box.rejected == 0


def test_samples_of_a_stopped_clock_are_accepted() -> None:
    box = Mailbox(WHEELS, forward=True)
    for arrived_ms in range(0, 500, 50):
        box.store(ticks_at(7), arrived_ms * NS_PER_MS)
    assert box.fresh(450 * NS_PER_MS) is not None
    assert box.rejected == 0


@each(
    ("bad", "words"),
    [
        (Sample(ENCODING, b"garbage"), "frame of 7 bytes is too short"),
        (sample(SCAN), "carries SonarScan, not WheelTicks"),
        (
            sample(encoding=f"{ENCODING_FAMILY};sidestep@9"),
            f"has dialect sidestep@9, not {DIALECT}",
        ),
        (sample(encoding=ENCODING_FAMILY), f"is encoded as {ENCODING_FAMILY}, not as {ENCODING}"),
        (sample(encoding="text;plain"), f"is encoded as text;plain, not as {ENCODING}"),
        (sample(encoding=""), f"is encoded as nothing, not as {ENCODING}"),
        (sample(encoding="x" * 61), f"is encoded as {'x' * 60}, not as {ENCODING}"),
        (sample(encoding="\x1b]0;a\x07\n"), f"is encoded as ?]0;a??, not as {ENCODING}"),
        (sample(encoding="application/mavlink2;\x9b2J"), f"has dialect ?2J, not {DIALECT}"),
    ],
)
def test_unreadable_sample_is_counted_named_and_ignored(bad: Sample, words: str) -> None:
    box = Mailbox(WHEELS)
    box.store(sample(), 10)
    assert box.latest() == (TICKS, 10)
    box.store(bad, 20)
    assert box.latest() == (TICKS, 10)
    assert box.latest() == (TICKS, 10)
    assert box.rejected == 1
    assert box.last_rejection == words


def test_a_key_with_several_messages_names_them_all() -> None:
    with pytest.raises(RemoteError, match=r"^carries WheelTicks, not SonarScan or Statustext$"):
        opened(sample(), (SonarScan, Statustext))


@given(st.binary(max_size=200))
def test_random_bytes_never_get_through(noise: bytes) -> None:
    box = Mailbox(WHEELS)
    box.store(Sample(ENCODING, noise), 0)
    assert box.latest() is None
    assert box.rejected == 1


def test_waiter_is_notified_of_each_arrival() -> None:
    heard: list[int] = []
    box = Mailbox(WHEELS, heard.append)
    box.store(sample(), 10)
    box.store(sample(), 20)
    assert heard == [10, 20]


def test_mailbox_may_accept_a_single_sender_only() -> None:
    heard: list[int] = []
    box = Mailbox(WHEELS, heard.append, accept=lambda sender: sender == "ada")
    box.store(sample()._replace(sender="bob"), 10)
    box.store(sample(), 20)
    assert (box.latest(), heard, box.rejected) == (None, [], 0)
    box.store(sample()._replace(sender="ada"), 30)
    assert box.latest() == (TICKS, 30)
    assert heard == [30]


def test_invalid_sample_replaces_no_message_and_wakes_no_waiter() -> None:
    heard: list[int] = []
    box = Mailbox(WHEELS, heard.append)
    box.store(sample(), 10)
    whole = sample().payload
    wrong = whole[:-1] + bytes([whole[-1] ^ 1])
    for noise in (b"", whole[:-1], whole + b"\0", b"\xff" * 300, b"\xfd" * 1_000_000, wrong):
        box.store(Sample(ENCODING, noise), 20)
    box.store(sample(SCAN), 20)
    box.store(sample(encoding="application/mavlink2;sidestep@9"), 20)
    assert box.rejected == 8, "counted as they come, looked at or not"
    assert heard == [10]
    assert box.latest() == (TICKS, 10)


def test_sample_that_fails_the_check_is_counted_and_ignored() -> None:
    heard: list[int] = []
    wrong = ["", "is forged"]
    box = Mailbox(WHEELS, heard.append, check=lambda _: wrong.pop(0))
    box.store(sample(), 10)
    newer = WheelTicks(time_ns=2, seq=2, left=4, right=5, bumper=0, expired=0)
    box.store(sample(newer), 20)
    assert box.latest() == (TICKS, 10)
    assert (box.rejected, box.last_rejection) == (1, "WheelTicks is forged")
    assert heard == [10]


def sent(sent_ns: int | None, sender: str = "ada", seq: int = 1) -> Sample:
    ticks = WheelTicks(time_ns=0, seq=seq, left=0, right=0, bumper=0, expired=0)
    return sample(ticks)._replace(sender=sender, sent_ns=sent_ns)


@each(
    ("newer", "taken"),
    [
        (sent(99, seq=2), False),
        (sent(100, seq=2), True),
        (sent(101, seq=2), True),
        (sent(None, seq=2), True),
        (sent(99, sender="bob", seq=2), True),
    ],
)
def test_older_sample_of_the_same_sender_is_ignored(newer: Sample, taken: bool) -> None:
    heard: list[int] = []
    box = Mailbox(WHEELS, heard.append, accept=lambda _: True)
    box.store(sent(100), 110)
    box.store(newer, 120)
    message, origin = box.received()[-1]
    if taken:
        assert (message.seq, origin) == (2, Origin(newer.sender, newer.sent_ns, 120))
    else:
        assert (message.seq, origin) == (1, Origin("ada", 100, 110))
    assert heard == ([110, 120] if taken else [110])
    assert box.rejected == 0, "late is not wrong"


@each("ahead_ns", [1, 3_600 * 10**9])
def test_sending_time_is_at_most_the_arrival(ahead_ns: int) -> None:
    """A sender whose clock has jumped ahead is heard on when its time is right again."""
    box = Mailbox(WHEELS, accept=lambda _: True)
    found = []
    for sent_ns, arrived_ns in ((100 + ahead_ns, 100), (100, 300), (99, 400)):
        box.store(sent(sent_ns), arrived_ns)
        found.append([origin[1:] for _, origin in box.received()])
    assert found == [[(100, 100)], [(100, 300)], []]


def test_any_time_is_accepted_after_a_sample_without_time() -> None:
    box = Mailbox(WHEELS, accept=lambda _: True)
    box.store(sent(None), 10)
    box.store(sent(5, seq=2), 20)
    assert box.received() == [(opened(sent(5, seq=2), (WheelTicks,)), Origin("ada", 5, 20))]


def test_senders_do_not_displace_each_other() -> None:
    box = Mailbox(WHEELS, accept=lambda _: True)
    for number in range(MAX_SENDERS):
        box.store(sent(100, sender=f"ada/{number}", seq=number), 110)
    box.store(sent(101, sender="ada/1", seq=99), 111)
    received = box.received()
    assert [message.seq for message, _ in received] == [0, *range(2, MAX_SENDERS), 99]
    assert box.received() == [], "each message is returned once"
    box.store(sent(101, sender="ada/3", seq=7), 112)
    assert [(message.seq, one.sender) for message, one in box.received()] == [(7, "ada/3")]
    box.store(sent(100, sender="ada/3", seq=8), 113)
    assert box.received() == [], "sent before the newest of its sender, whatever came between"


def test_only_the_newest_senders_are_kept() -> None:
    box = Mailbox(WHEELS, accept=lambda _: True)
    for number in range(18):
        box.store(sent(100, sender=f"ada/{number}", seq=number), 110)
    assert [message.seq for message, _ in box.received()] == [*range(2, 18)]


def test_without_operators_no_sender_is_kept() -> None:
    box = Mailbox(WHEELS)
    box.store(sent(100), 10)
    assert box.received() == []


def test_sending_time_is_ignored_without_sender_ids() -> None:
    box = Mailbox(WHEELS)
    box.store(sent(100), 10)
    box.store(sent(99, seq=2), 20)
    newest = box.latest()
    assert newest is not None
    assert newest[0].seq == 2


def test_sample_has_no_sender_and_no_time_by_default() -> None:
    assert Sample(ENCODING, b"")[2:] == ("", None)


MANY = 4000


def send_through(
    trouble: LinkFaults, samples: int = MANY, key: str = "sidestep/r1/sense/sonar"
) -> list[int]:
    """Send a numbered sample every 50 ms; return all samples that are delivered."""
    way: FaultyLink[int] = FaultyLink(trouble, key)
    found = [one for number in range(samples) for one in way.take(number, number * 50 * MS)]
    return found + way.due(samples * 100 * MS)


def test_without_a_share_or_a_delay_all_pass_in_order() -> None:
    assert send_through(LinkFaults()) == list(range(MANY))


def test_loss_share_equals_the_requested_one() -> None:
    assert len(send_through(LinkFaults(loss=0.2))) == pytest.approx(0.8 * MANY, rel=0.03)
    assert send_through(LinkFaults(loss=1.0)) == []


def test_losses_depend_only_on_seed_and_key() -> None:
    first = send_through(LinkFaults(loss=0.2, seed=1))
    assert send_through(LinkFaults(loss=0.2, seed=1)) == first
    assert send_through(LinkFaults(loss=0.2, seed=2)) != first
    assert send_through(LinkFaults(loss=0.2, seed=1), key="sidestep/r1/drive/wheels") != first


def test_duplicate_follows_its_original() -> None:
    found = send_through(LinkFaults(duplicate=0.3))
    assert found == sorted(found)
    assert len(found) == pytest.approx(1.3 * MANY, rel=0.03)
    assert set(found) == set(range(MANY))


def test_overtaken_sample_follows_the_next_and_none_is_lost() -> None:
    found = send_through(LinkFaults(reorder=0.3), 40)
    assert found != sorted(found)
    assert max(abs(at - number) for at, number in enumerate(found)) == 1
    assert set(found) >= set(range(39)), "the very last may still be held back"


def test_each_sample_is_late_by_delay_plus_at_most_jitter() -> None:
    way: FaultyLink[str] = FaultyLink(LinkFaults(delay_ms=100, jitter_ms=50), "k")
    assert way.take("a", 0) == []
    assert way.due(100 * MS - 1) == []
    assert way.next_ns is not None
    assert 100 * MS <= way.next_ns <= 150 * MS
    assert way.due(150 * MS) == ["a"]
    assert way.next_ns is None


def test_earliest_due_time_covers_all_links() -> None:
    ways: list[FaultyLink[int]] = [FaultyLink(LinkFaults(delay_ms=ms), "k") for ms in (80, 20, 50)]
    assert earliest(ways) is None
    for way in ways:
        way.take(1, 0)
    assert earliest(ways) == 20 * MS


def test_fault_applies_to_named_topics_or_to_all() -> None:
    assert LinkFaults().concerns("tlm/text")
    assert LinkFaults(paths=("sense/", "drive/wheels")).concerns("sense/sonar")
    assert not LinkFaults(paths=("sense/", "drive/wheels")).concerns("tlm/text")


@each("field", ["loss", "duplicate", "reorder", "delay_ms", "jitter_ms"])
@each("value", [-0.1, 1e9])
def test_impossible_link_fault_is_rejected_by_name(field: str, value: float) -> None:
    with pytest.raises(UserError, match=field):
        LinkFaults(**{field: value})  # type: ignore[arg-type]


def test_link_faults_are_a_table_of_the_configuration(tmp_path: Path) -> None:
    file = tmp_path / "bad.toml"
    file.write_text('connect = ["tcp/127.0.0.1:1"]\n[trouble]\nloss = 0.05\npaths = ["sense/"]\n')
    assert config.load(file, Network).trouble == LinkFaults(loss=0.05, paths=("sense/",))
    file.write_text("[trouble]\nlos = 0.05\n")
    with pytest.raises(ConfigError, match="did you mean 'loss'"):
        config.load(file, Network)
