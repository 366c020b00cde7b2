"""What `bench flood` says of a press, and what its attackers send."""

from protocol.topics import OPERATOR, PREFIX, key_parts
from protocol.wire.codec import Encoder
from protocol.wire.messages import CycleReport
from verification.flood.acknowledgements import SLICE_NS, Shown, unfounded
from verification.flood.kinds import KINDS, Heard, id_in
from verification.flood.main import Run, figures_of
from verification.flood.operator import Pressed
from verification.flood.presses import UINT32, forbidden, frames, order, questions, wheels

EVE = "eve/0123"


def report(tick: int, missed: int) -> CycleReport:
    return CycleReport(
        time_ns=0, tick=tick, missed=missed, overruns=0, rejected=0, late_us=0, sense_age_us=0,
        budget_us=0, stage_us=(0,) * 5,
    )  # fmt: skip


def missed(*presses: Pressed) -> list[str]:
    found = Run(presses=list(presses), reports=[report(1, 0), report(9, 0)])
    return [figure.name for figure in figures_of("x", found) if figure.met is False]


def test_a_robot_that_stands_in_time_meets_all_limits() -> None:
    assert missed(Pressed(100.0, 40.0, 5000.0), Pressed(250.0, 60.0, 5000.0)) == []


def test_the_worst_press_is_judged_not_the_median() -> None:
    presses = [Pressed(100.0, 40.0, 5000.0)] * 9 + [Pressed(251.0, 40.0, 5000.0)]
    assert missed(*presses) == ["x: key to standing, worst of 10"]


def test_an_acknowledged_stop_after_which_the_robot_drives_is_told() -> None:
    assert "x: acknowledgements that were none" in missed(Pressed(None, 40.0, 5000.0))
    assert "x: acknowledgements that were none" in missed(Pressed(1500.0, 40.0, 5000.0))
    assert "x: acknowledgements that were none" not in missed(Pressed(None, None, 5000.0))


def test_robot_that_the_plant_was_not_heard_of_was_not_seen_to_move() -> None:
    assert missed(Pressed(None, 40.0, 900.0)) == ["x: never stood or acknowledged"]


def test_a_stop_that_nobody_acknowledges_is_told() -> None:
    assert missed(Pressed(90.0, None, 5000.0)) == ["x: never stood or acknowledged"]


def test_operator_frames_and_requests_name_their_sender_as_the_robot_reads_it() -> None:
    senders = set()
    for shot in (*frames(EVE), *questions(EVE)):
        parts = key_parts(f"{PREFIX}/r1/{shot.path}")
        assert parts is not None
        senders.add(parts.operator)
    assert senders == {"", EVE, "eve/0123456789abcdef"}
    assert any(shot.path.startswith(f"{OPERATOR.path}/") for shot in frames(EVE))


def test_forged_wheel_commands_answer_past_newest_and_future_senses() -> None:
    answered = {command.sense_seq for command in wheels(70)}
    assert {0, 70, 71, UINT32} <= answered
    assert {command.epoch for command in wheels(70)} == {0, UINT32}


def test_the_id_of_an_overheard_request_is_read_and_noise_has_none() -> None:
    frame = Encoder(1, 1).encode(order(77, 400))
    assert id_in(Heard("", frame, "", None)) == 77
    assert id_in(Heard("", b"noise", "", None)) == 0


def test_requests_that_only_a_holder_may_make_are_judged() -> None:
    assert len(forbidden()) >= 12
    assert {name for name, kind in KINDS.items() if kind.judged} == {"questions", "collisions"}


def test_accepted_stop_of_an_attacker_is_borne_out_by_a_status_of_about_that_time() -> None:
    moved, stood = Shown(10 * SLICE_NS, stopped=False), Shown(12 * SLICE_NS, stopped=True)
    shown = [moved, stood, Shown(20 * SLICE_NS, stopped=False)]
    assert unfounded({10: 5, 13: 7}, shown) == 0
    assert unfounded({13: 7, 20: 2}, shown) == 2
    assert unfounded({6: 1, 15: 4}, shown) == 5
    assert unfounded({13: 7}, []) == 7
    assert unfounded({5: 3}, [moved, Shown(40 * SLICE_NS, stopped=True)]) == 3
    assert unfounded({5: 3}, [Shown(40 * SLICE_NS, stopped=True)]) == 0
