"""A log is read up to a cut and around damage."""

import io
from itertools import accumulate

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ground.recording.log_reader import Record, TlogReader, frame_size, is_whole_frame, record_bytes
from protocol.wire.codec import Encoder
from protocol.wire.messages import Statustext, WheelTicks

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
