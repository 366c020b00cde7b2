"""Recordings as tables, written to files that are replaced completely or not at all."""

import io
import re
import tempfile
from collections.abc import Sequence
from math import inf, nan
from pathlib import Path
from struct import pack

import pytest
from hypothesis import given
from hypothesis import strategies as st

from checks.harness.messages import make
from ground.recording.log_reader import open_log
from ground.recording.tables import (
    LONG,
    TimeAxis,
    fields_of,
    long_rows,
    shortest_single,
    wide_columns,
    wide_rows,
    write_csv,
)
from protocol.topics import COMMANDED, CYCLE, HEARTBEAT, ODOMETRY, TELEOP, TEXT, WHEELS
from protocol.wire.enums import Severity
from protocol.wire.messages import CycleReport, SonarScan, Statustext, Teleop
from runtime.errors import UserError
from runtime.files import replace_named
from tests.support.ground.made_recordings import (
    BEAT,
    GOAL,
    PERIOD_US,
    START_US,
    PublishedFrame,
    TopicEncoder,
    decision,
    odometry,
    run,
    tlog,
    wheels,
)

CYCLE_REPORT = make(
    CycleReport,
    time_ns=5_000_000_000,
    tick=1,
    late_us=9,
    sense_age_us=1,
    budget_us=2,
    stage_us=(1, 2, 3, 4, 5),
)


STICK = Teleop(time_ns=36_000 * 10**9, seq=1, speed_mm_s=200, yaw_rate_mrad_s=0, ttl_ms=250)


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "a.tlog"


def long_table(
    path: Path, frames_sent: Sequence[PublishedFrame], **ends: float
) -> list[list[str | None]]:
    return list(long_rows(TimeAxis(open_log(tlog(path, list(frames_sent))), **ends)))


def wide_table(
    path: Path, frames_sent: Sequence[PublishedFrame], rate_hz: float
) -> list[dict[str, str | None]]:
    tlog(path, list(frames_sent))
    columns = wide_columns(TimeAxis(open_log(path)))
    names = [column.name for column in columns]
    rows = wide_rows(TimeAxis(open_log(path)), columns, rate_hz)
    return [dict(zip(names, row, strict=True)) for row in rows]


def test_long_table_has_a_row_per_field_and_element(path: Path) -> None:
    rows = long_table(path, [TopicEncoder().publish(CYCLE, CYCLE_REPORT, START_US)])
    begin = ["5.000000", "1790000000.000000", "tlm/cycle", "CYCLE_REPORT"]
    assert [*begin, "late_us", "9"] in rows
    assert [*begin, "stage_us[4]", "5"] in rows
    assert {len(row) for row in rows} == {len(LONG)}


def test_message_without_stamp_gets_the_previous_one(path: Path) -> None:
    encoder = TopicEncoder()
    rows = long_table(
        path,
        [
            encoder.publish(HEARTBEAT, BEAT, START_US),
            encoder.publish(WHEELS, wheels(3_000_000_000, 1), START_US + 1),
            encoder.publish(COMMANDED, GOAL, START_US + 2),
            encoder.publish(WHEELS, wheels(4_000_000_000, 2), START_US + 3),
        ],
    )
    times = {row[2]: row[0] for row in reversed(rows)}
    assert times["tlm/heartbeat"] == "3.000000", "the first stamp of the recording"
    assert times["tlm/commanded"] == "3.000000"


def test_operator_stamps_are_ignored(path: Path) -> None:
    encoder = TopicEncoder()
    frames_sent = [
        encoder.publish(WHEELS, wheels(3_000_000_000, 1), START_US),
        encoder.publish(TELEOP, STICK, START_US + 1),
        encoder.publish(COMMANDED, GOAL, START_US + 2),
        encoder.publish(WHEELS, wheels(3_050_000_000, 2), START_US + 3),
    ]
    assert {row[2]: row[0] for row in long_table(path, frames_sent)} == {
        "sense/wheels": "3.050000",
        "op/teleop": "3.000000",
        "tlm/commanded": "3.000000",
    }
    assert len(wide_table(path, frames_sent, rate_hz=20.0)) == 2


def test_time_range_limits_the_table(path: Path) -> None:
    rows = long_table(path, list(run(40)), begin_s=0.5, end_s=1.0)
    assert {row[0] for row in rows} == {f"{tick * 0.05:.6f}" for tick in range(10, 21)}


def test_csv_quotes_special_characters(path: Path) -> None:
    nasty = 'a,"b"\nc'
    rows = long_table(
        path,
        [TopicEncoder().publish(TEXT, Statustext(severity=Severity.INFO, text=nasty), START_US)],
    )
    target = io.StringIO()
    assert write_csv(target, LONG, rows) == len(rows)
    assert '"a,""b""\nc"' in target.getvalue()


def test_range_without_an_echo_is_empty() -> None:
    scan = make(SonarScan, range_mm=(0, 803, *(0,) * 6), valid=0b11, echo=0b10)
    cells = [cell.text for cell in fields_of(scan) if cell.name.startswith("range_mm")]
    assert cells == [None, "803", *[None] * 6]
    target = io.StringIO()
    write_csv(target, LONG, [["1.0", "1.0", "sense/sonar", "SONAR_SCAN", "range_mm[0]", cells[0]]])
    assert target.getvalue().endswith("range_mm[0],\n")


def test_missing_is_nan_and_no_echo_is_inf() -> None:
    cells = {cell.name: cell.text for cell in fields_of(decision(0, (nan, inf)))}
    assert (cells["virtual_x_m"], cells["virtual_y_m"]) == ("nan", "inf")
    assert cells["zone_m"] == "0.3"


def test_wide_table_has_a_row_per_grid_instant(path: Path) -> None:
    rows = wide_table(path, list(run(40)), rate_hz=10.0)
    assert [row["time_s"] for row in rows] == [f"{n / 10:.6f}" for n in range(21)]
    assert rows[10]["tlm/odometry.x_m"] == "0.725", "the value at 1.0 s"
    assert rows[10]["sense/sonar.range_mm[3]"] == "803"


def test_wide_table_holds_the_last_value(path: Path) -> None:
    rows = wide_table(path, list(run(4)), rate_hz=100.0)
    ticks = [row["sense/wheels.left"] for row in rows]
    assert ticks == ["0"] + ["0"] * 4 + ["1"] * 5 + ["2"] * 5 + ["3"]


def test_stale_value_is_empty(path: Path) -> None:
    encoder = TopicEncoder()
    frames_sent = [encoder.publish(ODOMETRY, odometry(0, 1.0), START_US)]
    frames_sent += [
        encoder.publish(WHEELS, wheels(n * 50_000_000, n), START_US + n) for n in range(1, 21)
    ]
    rows = wide_table(path, frames_sent, rate_hz=20.0)
    shown = [row["time_s"] for row in rows if row["tlm/odometry.x_m"] is not None]
    assert shown == [f"{n * 0.05:.6f}" for n in range(6)], "valid for 250 ms"


def test_event_is_in_one_row_only(path: Path) -> None:
    rows = wide_table(path, list(run(40)), rate_hz=50.0)
    name = "tlm/commanded.GOAL_REQUEST.x_mm"
    assert [row["time_s"] for row in rows if row[name] is not None] == ["0.500000"]


def test_slow_grid_shows_an_event_in_the_next_row(path: Path) -> None:
    encoder = TopicEncoder()
    frames_sent = [
        encoder.publish(WHEELS, wheels(0, 0), START_US),
        encoder.publish(WHEELS, wheels(300_000_000, 1), START_US + 1),
        encoder.publish(COMMANDED, GOAL, START_US + 2),
        encoder.publish(WHEELS, wheels(2_000_000_000, 2), START_US + 3),
    ]
    rows = wide_table(path, frames_sent, rate_hz=1.0)
    name = "tlm/commanded.GOAL_REQUEST.mode"
    assert [row[name] for row in rows] == [None, "15", None]


def test_plant_restart_begins_another_grid(path: Path) -> None:
    encoder = TopicEncoder()
    stamps_ms = (5000, 5050, 0, 50, 100)
    frames_sent = [
        encoder.publish(WHEELS, wheels(at_ms * 1_000_000, n), START_US + n)
        for n, at_ms in enumerate(stamps_ms)
    ]
    rows = wide_table(path, frames_sent, rate_hz=20.0)
    assert [row["time_s"] for row in rows] == [f"{at_ms / 1000:.6f}" for at_ms in stamps_ms]
    assert [row["sense/wheels.left"] for row in rows] == ["0", "1", "2", "3", "4"]


def test_distant_stamp_adds_no_empty_rows(path: Path) -> None:
    encoder = TopicEncoder()
    stamps_ns = (0, 10**18, 50_000_000)
    frames_sent = [
        encoder.publish(WHEELS, wheels(at, n), START_US + n) for n, at in enumerate(stamps_ns)
    ]
    assert [row["sense/wheels.left"] for row in wide_table(path, frames_sent, rate_hz=20.0)] == [
        "0",
        "1",
        "2",
    ]


def test_columns_follow_the_order_of_the_topics(path: Path) -> None:
    forwards = wide_columns(TimeAxis(open_log(tlog(path, list(run(12))))))
    backwards = wide_columns(TimeAxis(open_log(tlog(path, list(reversed(list(run(12))))))))
    assert forwards == backwards
    assert forwards[0].name == "time_s"


def test_empty_recording_gives_no_rows(path: Path) -> None:
    assert wide_table(path, [], 10.0) == []
    assert long_table(path, []) == []


@given(st.floats(width=32, allow_nan=False, allow_infinity=False))
def test_shortest_text_keeps_the_32_bit_value(value: float) -> None:
    assert pack("<f", float(shortest_single(value))) == pack("<f", value)


@given(
    st.lists(st.integers(0, 60), min_size=1, max_size=20),
    st.sampled_from([1.0, 7.0, 20.0, 33.0]),
)
def test_values_are_shown_only_while_valid(ticks: list[int], rate_hz: float) -> None:
    encoder = TopicEncoder()
    frames_sent = [
        encoder.publish(WHEELS, wheels(tick * PERIOD_US * 1000, tick), START_US)
        for tick in sorted(ticks)
    ]
    with tempfile.TemporaryDirectory() as folder:
        rows = wide_table(Path(folder) / "a.tlog", frames_sent, rate_hz)
    for row in rows:
        shown = row["sense/wheels.seq"]
        if shown is not None:
            age_s = float(str(row["time_s"])) - int(shown) * 0.05
            assert -1e-6 <= age_s <= 0.15 + 1e-6


def test_symbolic_link_is_preserved(tmp_path: Path) -> None:
    real, link = tmp_path / "kept" / "tour.toml", tmp_path / "tour.toml"
    real.parent.mkdir()
    real.write_text("before")
    link.symlink_to(real)
    replace_named(link, "after")
    assert link.is_symlink()
    assert real.read_text() == "after"
    assert [path.name for path in real.parent.iterdir()] == ["tour.toml"]


@pytest.mark.parametrize("name", ["with blank.toml", "-x.toml", "ä\n*?.toml", ".toml", "a" * 240])
def test_unusual_file_names_are_accepted(tmp_path: Path, name: str) -> None:
    replace_named(tmp_path / name, "text")
    assert [path.name for path in tmp_path.iterdir()] == [name]
    assert (tmp_path / name).read_text() == "text"


@pytest.mark.parametrize(
    ("name", "why"),
    [
        ("no/such/file.toml", "no such file or directory"),
        ("folder", "is a directory"),
        ("file/below", "not a directory"),
        ("a" * 256, "file name too long"),
    ],
)
def test_failed_replace_names_the_reason_and_changes_nothing(
    tmp_path: Path, name: str, why: str
) -> None:
    (tmp_path / "folder").mkdir()
    (tmp_path / "file").write_text("names_in")
    before = sorted(tmp_path.iterdir())
    with pytest.raises(UserError, match=f"{re.escape(name)}: .*{why}"):
        replace_named(tmp_path / name, "text")
    assert sorted(tmp_path.iterdir()) == before
    assert (tmp_path / "file").read_text() == "names_in"
