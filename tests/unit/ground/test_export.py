"""A log becomes a table that a spreadsheet can read, and says what it could not use."""

import csv
import io
from math import inf, isnan, nan
from struct import pack, unpack

from hypothesis import given
from hypothesis import strategies as st

from ground.export import COLUMNS, export, shortest_single
from ground.tlog import Reader, record_bytes
from protocol.codec import Encoder
from protocol.message import Message
from protocol.messages import AvoidanceDecision, CycleReport, Statustext

START_US = 1_790_000_000_500_000
CYCLE = CycleReport(
    time_ns=5,
    tick=1,
    missed=0,
    overruns=0,
    rejected=0,
    late_us=9,
    sense_age_us=1,
    budget_us=2,
    stage_us=(1, 2, 3, 4, 5),
)
DECISION = AvoidanceDecision(
    time_ns=1,
    nearest_bearing_rad=nan,
    nearest_range_m=inf,
    zone_m=unpack("<f", pack("<f", 0.3))[0],
    goal_bearing_rad=0.0,
    rotation_rad=0.0,
    virtual_x_m=0.0,
    virtual_y_m=0.0,
    speed_m_s=0.0,
    yaw_rate_rad_s=0.0,
    branch=0,
    guard=0,
)


def log(*messages: Message) -> bytes:
    encoder = Encoder(1, 1)
    return b"".join(record_bytes(START_US, encoder.encode(message)) for message in messages)


def table(data: bytes) -> tuple[list[list[str]], str]:
    target = io.StringIO()
    tally = export(Reader(io.BytesIO(data)), target)
    rows = list(csv.reader(io.StringIO(target.getvalue())))
    assert tally.rows == len(rows) - 1
    return rows, tally.damage


def test_every_field_is_a_row_and_arrays_are_numbered() -> None:
    rows, damage = table(log(CYCLE))
    assert rows[0] == list(COLUMNS)
    assert ["1790000000.500000", "CYCLE_REPORT", "late_us", "9"] in rows
    assert ["1790000000.500000", "CYCLE_REPORT", "stage_us[4]", "5"] in rows
    assert damage == ""


def test_text_with_commas_quotes_and_line_ends_survives() -> None:
    nasty = 'a,"b"\nc'
    rows, _ = table(log(Statustext(severity=4, text=nasty)))
    assert [row[3] for row in rows if row[2] == "text"] == [nasty]


def test_missing_is_nan_and_no_echo_is_inf() -> None:
    rows, _ = table(log(DECISION))
    values = {row[2]: row[3] for row in rows}
    assert isnan(float(values["nearest_bearing_rad"]))
    assert float(values["nearest_range_m"]) == inf
    assert values["zone_m"] == "0.3"


def test_a_damaged_tail_is_reported() -> None:
    rows, damage = table(log(CYCLE, CYCLE)[:-5])
    assert len(rows) > 1
    assert "left out" in damage


def test_a_frame_of_a_newer_dialect_is_counted() -> None:
    foreign = bytes([0xFD, 1, 0, 0, 0, 1, 1, 0x11, 0x22, 0x33, 7, 0, 0])
    data = record_bytes(START_US, foreign) + log(CYCLE)
    tally = export(Reader(io.BytesIO(data)), io.StringIO())
    assert (tally.frames, tally.unreadable, tally.lost_bytes) == (2, 1, 0)


@given(st.floats(width=32, allow_nan=False, allow_infinity=False))
def test_the_shortest_text_is_the_same_number_on_the_wire(value: float) -> None:
    assert pack("<f", float(shortest_single(value))) == pack("<f", value)
