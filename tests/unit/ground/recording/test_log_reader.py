"""Recordings as they are read: both formats, whole or damaged, by an index of time."""

import io
import os
import random
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import accumulate
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from checks.harness.messages import make
from ground.recording.log_reader import (
    MAX_TIME_NS,
    LoggedFrame,
    LogIndex,
    Record,
    TlogReader,
    frame_size,
    is_whole_frame,
    key_of,
    open_log,
    record_bytes,
    robot_in,
)
from ground.recording.mcap_file import McapFormat
from ground.recording.summary import Bookmark, changes, outcome, outcome_of
from protocol.topics import CLOCK, WHEELS
from protocol.wire.codec import Encoder
from protocol.wire.enums import GoalState, Mode
from protocol.wire.messages import (
    Heartbeat,
    MissionCurrent,
    NavigatorStatus,
    ParamRequestList,
    Statustext,
    SystemTime,
    WheelTicks,
)
from protocol.wire.reasons import Reason
from runtime.errors import UserError
from runtime.units import NS_PER_S as S
from tests.support.each import each
from tests.support.ground.made_recordings import (
    PublishedFrame,
    TopicEncoder,
    mcap,
    mcap_of_before,
    run,
    tlog,
    wheels,
)

START_US = 1_790_000_000_000_000


def frames(count: int) -> list[bytes]:
    encoder = Encoder(1, 1)
    return [
        encoder.encode(
            WheelTicks(time_ns=n, seq=n, left=n, right=-n, bumper=0, expired=0)
            if n % 2
            else Statustext(severity=6, text="x" * n)
        )
        for n in range(count)
    ]


def log(count: int) -> list[bytes]:
    return [record_bytes(START_US + n * 1000, frame) for n, frame in enumerate(frames(count))]


def reading(data: bytes) -> tuple[list[Record], TlogReader]:
    reader = TlogReader(io.BytesIO(data))
    return list(reader), reader


def test_written_records_are_read_back() -> None:
    records, reader = reading(b"".join(log(20)))
    assert [record.frame for record in records] == frames(20)
    assert [record.time_us for record in records] == [START_US + n * 1000 for n in range(20)]
    assert reader.damage() == ""


@each("began_us", [0, 18_000_000_000_000, 7_300_000_000_000_000])
def test_record_of_a_clock_that_was_never_set_is_read(began_us: int) -> None:
    written = [record_bytes(began_us + n, frame) for n, frame in enumerate(frames(20))]
    records, reader = reading(b"".join(written))
    assert [record.time_us for record in records] == [began_us + n for n in range(20)]
    assert reader.damage() == ""


def test_frames_of_mavlink_1_are_no_damage(tmp_path: Path) -> None:
    beat = b"\xfe\x09\x00\x01\x01\x00" + bytes(9) + b"\x12\x34"
    path = tmp_path / "old.tlog"
    path.write_bytes(b"".join(record_bytes(START_US + n, beat) for n in range(5)))
    log_index = LogIndex(open_log(path))
    assert (len(log_index), log_index.damage) == (5, "")
    assert log_index.key(0) == "sidestep/r1/unknown/mavlink1"


def test_truncated_tlog_is_read_to_the_cut() -> None:
    written = log(8)
    data, ends = b"".join(written), [0, *accumulate(map(len, written))]
    for cut in range(len(data) + 1):
        records, reader = reading(data[:cut])
        survivors = max(index for index, end in enumerate(ends) if end <= cut)
        assert len(records) == survivors, f"cut at {cut}"
        assert reader.lost_bytes == cut - ends[survivors]
        assert bool(reader.damage()) == (cut not in ends)


def test_damage_loses_only_its_own_record() -> None:
    written = log(10)
    written[4] = written[4][:8] + b"\0" * (len(written[4]) - 8)
    records, reader = reading(b"".join(written))
    assert len(records) == 9
    assert reader.gaps == 1
    assert "one place" in reader.damage()


def test_partial_record_loses_only_itself() -> None:
    written = log(4)
    records, _ = reading(written[0] + written[1][:13] + written[2] + written[3])
    assert frames(4)[3] in [record.frame for record in records]
    assert len(records) >= 2


@given(st.binary(max_size=400))
def test_noise_raises_nothing(noise: bytes) -> None:
    records, reader = reading(noise)
    used = sum(8 + len(record.frame) for record in records)
    assert used + reader.lost_bytes == len(noise)


@given(st.integers(0, 7), st.binary(min_size=1, max_size=60))
def test_noise_between_records_keeps_the_rest(place: int, noise: bytes) -> None:
    written = log(40)
    records, _ = reading(b"".join(written[:place]) + noise + b"".join(written[place:]))
    assert frames(40)[-1] == records[-1].frame


@pytest.mark.parametrize("size", [10_000])
def test_long_log_is_read_in_pieces(size: int) -> None:
    encoder = Encoder(1, 1)
    tick = WheelTicks(time_ns=1, seq=1, left=1, right=1, bumper=1, expired=1)
    data = b"".join(record_bytes(START_US + n, encoder.encode(tick)) for n in range(size))
    assert len(reading(data)[0]) == size


def test_frame_size_is_in_its_header() -> None:
    (frame,) = frames(1)
    assert is_whole_frame(frame)
    assert not is_whole_frame(frame[:-1])
    assert not is_whole_frame(frame + b"\0")
    assert not is_whole_frame(b"")
    assert frame_size(bytes([0xFD, 4, 1])) == 10 + 4 + 2 + 13


def test_bytes_between_records_are_counted_exactly() -> None:
    """Skip junk, even when it resembles the start of a frame."""
    first, second = log(2)
    for junk in (b"\xfd", b"\xfd" * 40, b"x" * 300, bytes(range(256)) * 3, first[:-1]):
        records, reader = reading(first + junk + second)
        assert [record.frame for record in records] == frames(2)
        assert (reader.lost_bytes, reader.gaps) == (len(junk), 1)


def test_large_file_without_records_is_read_quickly() -> None:
    records, reader = reading(bytes(30_000_000))
    assert (records, reader.lost_bytes) == ([], 30_000_000)


@pytest.fixture
def frames_sent() -> list[PublishedFrame]:
    return list(run(12))


def as_frames(frames_sent: list[PublishedFrame]) -> list[LoggedFrame]:
    return [LoggedFrame(one.time_us * 1000, one.key, one.frame) for one in frames_sent]


def test_both_formats_give_the_same_frames(
    tmp_path: Path, frames_sent: list[PublishedFrame]
) -> None:
    assert list(open_log(tlog(tmp_path / "a.tlog", frames_sent))) == as_frames(frames_sent)
    assert list(open_log(mcap(tmp_path / "a.mcap", frames_sent))) == as_frames(frames_sent)


def test_older_mcap_gives_the_same_frames(
    tmp_path: Path, frames_sent: list[PublishedFrame]
) -> None:
    log = open_log(mcap_of_before(tmp_path / "a.mcap", frames_sent))
    assert list(log) == as_frames(frames_sent)
    assert log.damage() == ""


def test_keys_that_cannot_be_derived_are_kept(
    tmp_path: Path, frames_sent: list[PublishedFrame]
) -> None:
    """Keep keys of operator sessions and of anything outside the topics."""
    odd = [
        one._replace(key=f"sidestep/r1/op/beat/ada/{number % 3:x}") if number % 2 else one
        for number, one in enumerate(frames_sent)
    ]
    log = open_log(mcap(tmp_path / "a.mcap", odd, every=3))
    assert list(log) == as_frames(odd)


def test_key_is_not_carried_over_a_damaged_chunk(
    tmp_path: Path, frames_sent: list[PublishedFrame]
) -> None:
    """Do not assign the key of a lost frame to the next one."""
    form = McapFormat("r1", {})
    form.add(frames_sent[0].key, frames_sent[0].frame, frames_sent[0].time_us)
    begin = form.batch()
    form.add("sidestep/r1/op/beat/ada/1", frames_sent[1].frame, frames_sent[1].time_us)
    torn = bytearray(form.batch())
    torn[100] ^= 1
    form.add(frames_sent[2].key, frames_sent[2].frame, frames_sent[2].time_us)
    form.add("sidestep/r1/op/beat/ada/1", frames_sent[3].frame, frames_sent[3].time_us)
    path = tmp_path / "a.mcap"
    path.write_bytes(begin + torn + form.end())
    log = open_log(path)
    first, _, third, fourth = as_frames(frames_sent)[:4]
    assert list(log) == [first, third, fourth._replace(key="sidestep/r1/op/beat/ada/1")]
    assert log.damage()


def test_whole_file_has_no_damage_and_has_its_world(
    tmp_path: Path, frames_sent: list[PublishedFrame]
) -> None:
    log = open_log(mcap(tmp_path / "a.mcap", frames_sent))
    assert len(list(log)) == log.records == len(frames_sent)
    assert log.damage() == ""
    assert '"name": "made"' in log.facts["world"]


def test_truncated_mcap_yields_the_frames_before_the_cut(tmp_path: Path) -> None:
    expected, path = as_frames(list(run(2))), tmp_path / "cut.mcap"
    size = mcap(path, list(run(2)), every=5).stat().st_size
    most = len(expected)
    while size > 0:
        size -= 101 if most == len(expected) else 1  # the index at the end is not read here
        os.truncate(path, max(0, size))
        log = open_log(path)
        found = list(log)
        assert found == expected[: len(found)]
        assert len(found) <= most, "a shorter file never gives more"
        most = len(found)
        assert most == len(expected) or log.damage(), "a truncated file reports damage"
    assert most == 0


def test_damage_counts_the_unusable_bytes(
    tmp_path: Path, frames_sent: list[PublishedFrame]
) -> None:
    path = mcap(tmp_path / "a.mcap", frames_sent, every=7, closed=False)
    whole = path.read_bytes()
    lost = {}
    for cut in (1, 2, 3):
        path.write_bytes(whole[:-cut])
        log = open_log(path)
        list(log)
        lost[cut] = log.lost_bytes
    assert lost[1] > 3
    assert lost[1] - lost[2] == lost[2] - lost[3] == 1


def test_flipped_byte_loses_at_most_one_chunk(
    tmp_path: Path, frames_sent: list[PublishedFrame]
) -> None:
    path = mcap(tmp_path / "a.mcap", frames_sent, every=7)
    whole, expected, luck = path.read_bytes(), as_frames(frames_sent), random.Random(5)
    for _ in range(300):
        place = luck.randrange(8, len(whole))
        broken = bytearray(whole)
        broken[place] ^= 1 << luck.randrange(8)
        path.write_bytes(broken)
        log = open_log(path)
        assert all(frame in expected for frame in log)
        log.damage()


def test_noise_is_read_without_exception(tmp_path: Path) -> None:
    luck, path = random.Random(9), tmp_path / "noise.mcap"
    for _ in range(200):
        noise = luck.randbytes(luck.randrange(200))
        for begin in (b"", b"\x89MCAP0\r\n"):
            path.write_bytes(begin + noise)
            log = open_log(path)
            assert list(log) == []
            assert log.damage() or not begin + noise


def test_missing_file_is_a_user_error(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="No such file"):
        open_log(tmp_path / "none.tlog")
    with pytest.raises(UserError, match="not a regular file: name a recording"):
        open_log(tmp_path)


def test_file_name_contains_the_robot() -> None:
    assert robot_in(Path("20260304T120005Z-r7.tlog")) == "r7"
    assert robot_in(Path("20260304T120005Z-r7.1.mcap")) == "r7", "second file of the same second"
    assert robot_in(Path("20260304T120005Z-r-1.tlog")) == "r-1"
    assert robot_in(Path("20260304T120005Z-left-arm.mcap")) == "left-arm"
    assert robot_in(Path("mine.tlog")) == "r1"


def test_tlog_distinguishes_the_heartbeats() -> None:
    beat = Heartbeat(
        type=6, autopilot=8, base_mode=0, custom_mode=0, system_status=4, mavlink_version=3
    )
    assert key_of(Encoder(3, 1).encode(beat), "r3") == "sidestep/r3/tlm/heartbeat"
    assert key_of(Encoder(255, 190).encode(beat), "r3") == "sidestep/r3/op/heartbeat"


def test_message_without_topic_has_an_unknown_key() -> None:
    frame = Encoder(1, 77).encode(ParamRequestList(target_system=1, target_component=1))
    assert key_of(frame, "r1") == "sidestep/r1/unknown/param_request_list"
    frame = Encoder(1, 77).encode(MissionCurrent(seq=1, total=2, mission_state=0, mission_mode=0))
    assert key_of(frame, "r1").startswith("sidestep/r1/unknown/")


def test_renamed_file_and_other_prefix_keep_the_robot(
    tmp_path: Path,
) -> None:
    form = McapFormat("r7", {})
    for one in run(2, "r7"):
        form.add(one.key.replace("sidestep/", "yard/north/"), one.frame, one.time_us)
    path = tmp_path / "the one with the cart.mcap"
    path.write_bytes(form.end())
    log = open_log(path)
    assert log.robot == "r7"
    assert [frame.key for frame in log] == [one.key for one in run(2, "r7")]
    assert open_log(path, "r9").robot == "r9"


@dataclass
class Log:
    """A recording of the given frames."""

    frames: list[LoggedFrame]
    robot: str = "r1"
    facts: dict[str, str] = field(default_factory=dict)
    records: int = 0
    share: float = 1.0
    lost_bytes: int = 0

    def __iter__(self) -> Iterator[LoggedFrame]:
        return iter(self.frames)

    def damage(self) -> str:
        return ""


def ticks_at(*times_ns: int) -> list[LoggedFrame]:
    """Return wheel ticks with these times of arrival."""
    frames_sent = [TopicEncoder().publish(WHEELS, wheels(n, n), 0) for n in range(len(times_ns))]
    return [
        LoggedFrame(at_ns, one.key, one.frame)
        for at_ns, one in zip(times_ns, frames_sent, strict=True)
    ]


def beats_of(*times_us: int) -> list[LoggedFrame]:
    """Return frames of the plant's clock."""
    frames_sent = [
        TopicEncoder().publish(CLOCK, SystemTime(time_unix_usec=at_us, time_boot_ms=0), 0)
        for at_us in times_us
    ]
    return [LoggedFrame(S, one.key, one.frame) for one in frames_sent]


def times_of(frames: list[LoggedFrame]) -> list[int]:
    log_index = LogIndex(Log(frames))
    return [log_index[place].time_ns for place in range(len(log_index))]


def test_time_never_decreases() -> None:
    assert times_of(ticks_at(5 * S, 8 * S, 6 * S, 9 * S)) == [0, 3 * S, 3 * S, 4 * S]


def test_damaged_time_is_limited() -> None:
    assert times_of(ticks_at(1, 2**64 - 1, 3)) == [0, MAX_TIME_NS, MAX_TIME_NS]
    assert times_of(beats_of(0, 2**64 - 1, 50_000)) == [0, MAX_TIME_NS, MAX_TIME_NS]


def test_times_include_unreadable_frames() -> None:
    frames = ticks_at(S, 2 * S, 4 * S)
    frames[1] = frames[1]._replace(frame=b"nonsense")
    log_index = LogIndex(Log(frames))
    assert log_index.times_ns(WHEELS.path) == [0, S, 3 * S]
    assert [at_ns for at_ns, _ in log_index.on(WHEELS.path)] == [0, 3 * S]


def status(goal: int, reason: int = Reason.NONE) -> NavigatorStatus:
    return make(
        NavigatorStatus, goal_id=7, goal_x_m=1.0, goal_y_m=2.0, goal_distance_m=3.0,
        mode=Mode.AUTO, goal=goal, goal_reason=reason,
    )  # fmt: skip


@each(
    ("reason", "end", "mark"),
    [
        (Reason.UNREACHABLE, "unreachable", "UNREACHABLE: a closed boundary"),
        (Reason.LOST, "lost", "LOST: found no way"),
        (Reason.BLOCKED, "stuck", "STUCK: has not moved"),
    ],
)
def test_goal_given_up_is_named_by_its_reason(reason: Reason, end: str, mark: str) -> None:
    ended = status(GoalState.STUCK, reason)
    assert outcome_of(ended) == end
    assert outcome(ended).startswith(mark)


def test_other_goal_states_keep_their_names() -> None:
    assert outcome(status(GoalState.REACHED)) == "REACHED"
    assert outcome(status(99, Reason.BUMPER)) == "goal state 99: bumper contact"
    assert outcome_of(status(GoalState.DRIVING)) == "driving"


def test_goal_of_a_complete_recording_is_not_driven_any_more() -> None:
    driven = status(GoalState.AVOIDING)
    held = replace(driven, mode=Mode.HOLD)
    assert [outcome_of(one) for one in (driven, held)] == ["driving", "held"]
    assert {outcome_of(one, is_running=False) for one in (driven, held)} == {"unfinished"}
    assert outcome_of(status(GoalState.ABORTED), is_running=False) == "aborted"
    assert outcome_of(status(GoalState.NONE), is_running=False) == "no goal"


def test_goal_that_another_one_replaces_has_an_end() -> None:
    first, over = status(GoalState.DRIVING), status(GoalState.REACHED)
    other = replace(first, goal_id=8, goal_x_m=4.0)
    third = replace(first, goal_id=9, goal_x_m=5.0)
    statuses = [
        (0, first),
        (10**9, other),
        (2 * 10**9, replace(over, goal_id=8)),
        (3 * 10**9, third),
    ]
    assert changes(statuses) == [
        Bookmark(0.0, "goal", "goal 1.00 2.00"),
        Bookmark(1.0, "outcome", "REPLACED: by the goal 4.00 2.00"),
        Bookmark(1.0, "goal", "goal 4.00 2.00"),
        Bookmark(2.0, "outcome", "REACHED"),
        Bookmark(3.0, "goal", "goal 5.00 2.00"),
    ]
