"""`bench flood` and `bench stop_ways`: figures of a stop under attack."""

import tomllib
from pathlib import Path

from checks.flood.attackers import (
    KINDS,
    SLICE_NS,
    Captured,
    StopStatus,
    broken_frames,
    forbidden,
    forged_command,
    forged_questions,
    forged_wheels,
    id_in,
    unfounded,
)
from checks.flood.stop_ways import APP, ESTOP, StopRow, configuration, notes_of
from checks.flood.stop_ways import figures_of as stop_ways_figures_of
from checks.flood.under_attack import FloodRun, StopTimes, figures_of
from checks.harness.messages import make
from protocol.topics import OPERATOR, PREFIX, key_parts
from protocol.wire.codec import Encoder
from protocol.wire.messages import CycleReport
from robot.commands import needs_no_lease
from runtime.units import UINT32

EVE = "eve/0123"


def report(tick: int, missed: int) -> CycleReport:
    return make(CycleReport, tick=tick, missed=missed)


def missed(*presses: StopTimes) -> list[str]:
    found = FloodRun(presses=list(presses), reports=[report(1, 0), report(9, 0)])
    return [figure.name for figure in figures_of("x", found) if figure.met is False]


def test_robot_that_stops_in_time_meets_all_limits() -> None:
    assert missed(StopTimes(100.0, 40.0, 5000.0), StopTimes(250.0, 60.0, 5000.0)) == []


def test_worst_press_is_judged_instead_of_the_median() -> None:
    presses = [StopTimes(100.0, 40.0, 5000.0)] * 9 + [StopTimes(251.0, 40.0, 5000.0)]
    assert missed(*presses) == ["x: key to standstill, worst of 10"]


def test_acknowledged_stop_of_moving_robot_is_reported() -> None:
    assert "x: false acknowledgements" in missed(StopTimes(None, 40.0, 5000.0))
    assert "x: false acknowledgements" in missed(StopTimes(1500.0, 40.0, 5000.0))
    assert "x: false acknowledgements" not in missed(StopTimes(None, None, 5000.0))


def test_missing_plant_samples_are_no_false_acknowledgement() -> None:
    assert missed(StopTimes(None, 40.0, 900.0)) == ["x: never stopped or acknowledged"]


def test_unacknowledged_stop_is_reported() -> None:
    assert missed(StopTimes(90.0, None, 5000.0)) == ["x: never stopped or acknowledged"]


def test_payloads_carry_sender_names_that_the_robot_parses() -> None:
    senders = set()
    for payload in (*broken_frames(EVE), *forged_questions(EVE)):
        parts = key_parts(f"{PREFIX}/r1/{payload.path}")
        assert parts is not None
        senders.add(parts.operator)
    assert senders == {"", EVE, "eve/0123456789abcdef"}
    assert any(payload.path.startswith(f"{OPERATOR.path}/") for payload in broken_frames(EVE))


def test_forged_wheel_commands_answer_past_and_future_senses() -> None:
    answered = {command.sense_seq for command in forged_wheels(70)}
    assert {0, 70, 71, UINT32} <= answered
    assert {command.epoch for command in forged_wheels(70)} == {0, UINT32}


def test_request_id_is_read_from_captured_sample() -> None:
    frame = Encoder(1, 1).encode(forged_command(77, 400))
    assert id_in(Captured("", frame, "", None)) == 77
    assert id_in(Captured("", b"noise", "", None)) == 0


def test_attacks_with_forbidden_requests_are_judged() -> None:
    assert len(forbidden()) >= 11
    assert not [message for _, message in forbidden() if needs_no_lease(message)]
    assert {name for name, kind in KINDS.items() if kind.judged} == {"questions", "collisions"}


def test_accepted_stop_needs_status_of_about_that_time() -> None:
    moving, stopped = (
        StopStatus(10 * SLICE_NS, stopped=False),
        StopStatus(12 * SLICE_NS, stopped=True),
    )
    shown = [moving, stopped, StopStatus(20 * SLICE_NS, stopped=False)]
    assert unfounded({10: 5, 13: 7}, shown) == 0
    assert unfounded({13: 7, 20: 2}, shown) == 2
    assert unfounded({6: 1, 15: 4}, shown) == 5
    assert unfounded({13: 7}, []) == 7
    assert unfounded({5: 3}, [moving, StopStatus(40 * SLICE_NS, stopped=True)]) == 3
    assert unfounded({5: 3}, [StopStatus(40 * SLICE_NS, stopped=True)]) == 0


STOOD = StopTimes(90.0, 120.0, 5000.0)


def missed_stop(way: str, *presses: StopTimes, wanted: int = 2) -> list[str]:
    found = stop_ways_figures_of("x", way, wanted, StopRow(presses=list(presses)))
    return [figure.name for figure in found if figure.met is False]


def test_each_press_is_held_to_the_limit_of_its_way() -> None:
    late = StopTimes(301.0, 310.0, 5000.0)
    assert missed_stop(APP, STOOD, STOOD) == missed_stop(ESTOP, STOOD, late) == []
    assert missed_stop(APP, STOOD, late) == ["x: key to standstill, worst of 2"]
    very_late = StopTimes(1001.0, 1010.0, 5000.0)
    assert missed_stop(ESTOP, STOOD, very_late) == ["x: start of estop to standstill, worst of 2"]


def test_lost_press_and_one_that_was_never_made_are_missed() -> None:
    lost = StopTimes(None, None, 9000.0)
    assert missed_stop(APP, STOOD, lost) == ["x: not stopped, of 2", "x: not acknowledged"]
    assert missed_stop(APP, STOOD, wanted=2) == ["x: not stopped, of 2", "x: not acknowledged"]


def test_ticks_are_counted_from_the_first_report_to_the_newest() -> None:
    row, encoder = StopRow(presses=[STOOD]), Encoder(1, 1)
    for tick, lost in ((5, 2), (7, 2), (25, 6)):
        row.note("", encoder.encode(report(tick, lost)), 0)
    figures = {figure.name: figure.median for figure in stop_ways_figures_of("x", APP, 1, row)}
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
