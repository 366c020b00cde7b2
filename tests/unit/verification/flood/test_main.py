"""`bench flood`: the figures of an emergency stop, and the payloads of the attackers."""

from checks.flood.attack_kinds import (
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
from checks.flood.under_attack import FloodRun, StopTimes, figures_of
from protocol.topics import OPERATOR, PREFIX, key_parts
from protocol.wire.codec import Encoder
from protocol.wire.messages import CycleReport
from robot.lease import needs_no_lease
from runtime.units import UINT32

EVE = "eve/0123"


def report(tick: int, missed: int) -> CycleReport:
    return CycleReport(
        time_ns=0, tick=tick, missed=missed, overruns=0, rejected=0, late_us=0, sense_age_us=0,
        budget_us=0, stage_us=(0,) * 5,
    )  # fmt: skip


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
