"""A log is read up to wherever it was cut, and around whatever was damaged."""

import io
from itertools import accumulate

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ground.recording.tlog import Reader, Record, frame_size, record_bytes, whole
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


def reading(data: bytes) -> tuple[list[Record], Reader]:
    reader = Reader(io.BytesIO(data))
    return list(reader), reader


def test_what_was_written_is_read_back() -> None:
    records, reader = reading(b"".join(log(20)))
    assert [record.frame for record in records] == frames(20)
    assert [record.time_us for record in records] == [START_US + n * 1000 for n in range(20)]
    assert reader.damage() == ""


def test_a_log_cut_at_any_byte_is_read_up_to_the_cut() -> None:
    written = log(8)
    data, ends = b"".join(written), [0, *accumulate(map(len, written))]
    for cut in range(len(data) + 1):
        records, reader = reading(data[:cut])
        survivors = max(index for index, end in enumerate(ends) if end <= cut)
        assert len(records) == survivors, f"cut at {cut}"
        assert reader.lost_bytes == cut - ends[survivors]
        assert bool(reader.damage()) == (cut not in ends)


def test_damage_in_the_middle_costs_what_it_hit_and_no_more() -> None:
    written = log(10)
    written[4] = written[4][:8] + b"\0" * (len(written[4]) - 8)
    records, reader = reading(b"".join(written))
    assert len(records) == 9
    assert reader.gaps == 1
    assert "one place" in reader.damage()


def test_a_torn_record_with_a_whole_one_behind_it_loses_only_itself() -> None:
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
def test_noise_between_records_never_swallows_the_rest(place: int, noise: bytes) -> None:
    written = log(40)
    records, _ = reading(b"".join(written[:place]) + noise + b"".join(written[place:]))
    assert frames(40)[-1] == records[-1].frame


@pytest.mark.parametrize("size", [10_000])
def test_a_long_log_is_read_in_pieces(size: int) -> None:
    encoder = Encoder(1, 1)
    tick = WheelTicks(time_ns=1, seq=1, left=1, right=1, bumper=1, expired=1)
    data = b"".join(record_bytes(START_US + n, encoder.encode(tick)) for n in range(size))
    assert len(reading(data)[0]) == size


def test_a_frame_knows_its_own_size() -> None:
    (frame,) = frames(1)
    assert whole(frame)
    assert not whole(frame[:-1])
    assert not whole(frame + b"\0")
    assert not whole(b"")
    assert frame_size(bytes([0xFD, 4, 1])) == 10 + 4 + 2 + 13


def test_what_lies_between_two_records_is_left_out_to_the_byte() -> None:
    """Also where bytes of it look like the beginning of a frame."""
    first, second = log(2)
    for junk in (b"\xfd", b"\xfd" * 40, b"x" * 300, bytes(range(256)) * 3, first[:-1]):
        records, reader = reading(first + junk + second)
        assert [record.frame for record in records] == frames(2)
        assert (reader.lost_bytes, reader.gaps) == (len(junk), 1)


def test_a_large_file_that_is_no_log_is_given_up_in_moments() -> None:
    records, reader = reading(bytes(30_000_000))
    assert (records, reader.lost_bytes) == ([], 30_000_000)
