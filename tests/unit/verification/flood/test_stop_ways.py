"""`bench stop_ways`: the figures of a row, and the operator's file."""

import tomllib
from pathlib import Path

from checks.flood.stop_ways import APP, ESTOP, StopRow, configuration, figures_of, notes_of
from checks.flood.under_attack import StopTimes
from protocol.wire.codec import Encoder
from tests.unit.verification.flood.test_main import report

STOOD = StopTimes(90.0, 120.0, 5000.0)


def missed(way: str, *presses: StopTimes, wanted: int = 2) -> list[str]:
    found = figures_of("x", way, wanted, StopRow(presses=list(presses)))
    return [figure.name for figure in found if figure.met is False]


def test_each_press_is_held_to_the_limit_of_its_way() -> None:
    late = StopTimes(301.0, 310.0, 5000.0)
    assert missed(APP, STOOD, STOOD) == missed(ESTOP, STOOD, late) == []
    assert missed(APP, STOOD, late) == ["x: key to standstill, worst of 2"]
    very_late = StopTimes(1001.0, 1010.0, 5000.0)
    assert missed(ESTOP, STOOD, very_late) == ["x: start of estop to standstill, worst of 2"]


def test_lost_press_and_one_that_was_never_made_are_missed() -> None:
    lost = StopTimes(None, None, 9000.0)
    assert missed(APP, STOOD, lost) == ["x: not stopped, of 2", "x: not acknowledged"]
    assert missed(APP, STOOD, wanted=2) == ["x: not stopped, of 2", "x: not acknowledged"]


def test_ticks_are_counted_from_the_first_report_to_the_newest() -> None:
    row, encoder = StopRow(presses=[STOOD]), Encoder(1, 1)
    for tick, lost in ((5, 2), (7, 2), (25, 6)):
        row.note("", encoder.encode(report(tick, lost)), 0)
    figures = {figure.name: figure.median for figure in figures_of("x", APP, 1, row)}
    assert figures["x: ticks missed of 20"] == 4


def test_note_names_why_presses_were_repeated() -> None:
    row = StopRow(called=9, taken=2, killed=1)
    row.repeat("stuck")
    row.repeat("stuck")
    assert list(notes_of("x", row)) == [
        "x: 9 calls of strangers, 2 tries to take an id, router killed 1 times",
        "x: 2 presses repeated: 2 x stuck",
    ]


def test_operators_file_names_the_place_for_datagrams(tmp_path: Path) -> None:
    written = tomllib.loads(configuration(None, "r1", "tcp/127.0.0.1:7448"))
    assert written == {"robot": "r1", "network": {"stop_at": {"r1": "127.0.0.1:7448"}}}
    (tmp_path / "ground-anna.toml").write_text('[network.tls]\nca = "ca.pem"\n', encoding="utf-8")
    locked = tomllib.loads(configuration(tmp_path, "r1", "tls/127.0.0.1:7448"))
    assert locked["network"]["tls"]["ca"] == str(tmp_path / "ca.pem")
    assert locked["network"]["stop_at"] == {"r1": "127.0.0.1:7448"}
