"""`explain` on a recording describes the decision at any instant."""

import json
from pathlib import Path

import pytest

from ground.cli.main import main
from ground.explain.explanation import explain
from ground.explain.turns import Recorded
from ground.recording.log_reader import LogIndex
from protocol.topics import CYCLE, DECISION, STATUS
from protocol.wire.codec import decode
from protocol.wire.messages import AvoidanceDecision
from tests.support.ground.explain.decisions import turning_points
from tests.support.ground.recordings import BEGAN_NS, Recording, box

S = 1_000_000_000


@pytest.fixture(scope="module")
def run() -> Recording:
    return box()[0]


@pytest.fixture(scope="module")
def log(run: Recording, tmp_path_factory: pytest.TempPathFactory) -> str:
    return run.written(tmp_path_factory.mktemp("logs") / "20260101T000000Z-r1.tlog")


def decisions(run: Recording) -> list[AvoidanceDecision]:
    found = (decode(one.frame).message for one in run.found)
    return [one for one in found if isinstance(one, AvoidanceDecision)]


def test_each_tick_has_its_own_status_and_cost(run: Recording) -> None:
    told = Recorded(LogIndex(run))
    for at_ns in (0, 5 * S, 8 * S + 7):
        found = told.at(at_ns)
        assert found is not None
        decided_ns, explanation = found
        assert at_ns - 50_000_000 < decided_ns <= at_ns
        assert any(line.startswith("state") for line in explanation.lines)
        assert any(line.startswith("cycle    15 of 2500 us") for line in explanation.lines)


def test_no_explanation_before_the_first_decision(run: Recording) -> None:
    assert Recorded(LogIndex(run)).at(-1) is None
    assert Recorded(LogIndex(run.without(DECISION))).at(9 * S) is None
    assert Recorded(LogIndex(Recording())).at(0) is None


def test_decision_is_explained_without_status_and_cost(run: Recording) -> None:
    found = Recorded(LogIndex(run.without(STATUS, CYCLE))).at(6 * S)
    assert found is not None
    before, now = (one for one in decisions(run) if one.time_ns in (6 * S - 50_000_000, 6 * S))
    assert found[1] == explain(now, None, None, before)


def test_its_turning_points_are_those_of_the_run(run: Recording) -> None:
    turns = list(Recorded(LogIndex(run)).turns())
    points = turning_points(decisions(run))
    assert [(turn.at_ns, turn.words) for turn in turns] == [
        (point.time_ns, point.words) for point in points
    ]
    assert len(turns) > 5


def test_turning_point_wins_over_a_simultaneous_decision(run: Recording) -> None:
    """Frames of two ticks may come at once."""
    told = Recorded(LogIndex(run))
    turn = list(told.turns())[1]
    place = told._times_ns.index(turn.at_ns)
    for other in (place + 1, place - 1):
        before = told._times_ns[other]
        told._times_ns[other] = turn.at_ns
        found = told.at(turn.at_ns)
        assert found is not None
        assert any(turn.words in line for line in found[1].lines)
        told._times_ns[other] = before


def test_explain_prints_an_instant_in_words(log: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["explain", log, "--at", "6"]) == 0
    head, *lines = capsys.readouterr().out.splitlines()
    assert head.startswith("at 6.00 s it turns left ")
    assert "so it passes on the left" in head
    assert lines[0].startswith("  nearest  echo ")


def test_or_as_one_object(log: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["explain", log, "--at", "6", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert (found["ok"], found["at_s"]) == (True, 6.0)
    assert found["headline"].startswith("turns left")
    assert found["lines"]["branch"] == "passes on the left"


def test_without_a_time_it_is_the_last_turning_point(
    log: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["explain", log, "--turns", "--json"]) == 0
    turns = json.loads(capsys.readouterr().out)["turns"]
    assert main(["explain", log, "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["at_s"] == turns[-1]["at_s"]
    assert turns[-1]["changed"] in found["lines"]["changed"]


def test_the_turning_points_are_listed_with_their_times(
    log: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["explain", log, "--turns"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert "  goes for the goal -> passes on the left" in lines[1]
    assert lines[1].split()[1] == "s"


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--at", "9999"], "ends at"),
        (["--at", "-1"], "not within 0"),
        (["--at", "nan"], "not a finite number"),
    ],
)
def test_a_time_that_is_not_in_it_is_refused(
    log: str, words: list[str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["explain", log, *words]) == 2
    assert said in capsys.readouterr().err


def test_missing_or_empty_recording_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    empty = tmp_path / "empty.tlog"
    empty.write_bytes(b"")
    assert main(["explain", str(tmp_path / "nowhere.tlog")]) == 2
    assert main(["explain", str(empty)]) == 2
    assert main(["explain", str(empty), "--turns"]) == 0
    said = capsys.readouterr()
    assert "No such file" in said.err
    assert "no decision is recorded" in said.err
    assert "the decision never changed" in said.out


def test_damage_is_reported_and_the_rest_explained(
    run: Recording, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    whole = Path(run.written(tmp_path / "whole.tlog")).read_bytes()
    cut = tmp_path / "cut.tlog"
    cut.write_bytes(whole[: len(whole) // 2 + 7])
    assert main(["explain", str(cut), "--at", "1"]) == 1
    said = capsys.readouterr()
    assert "DAMAGED" in said.err
    assert said.out.startswith("at 1.00 s it drives straight on")


def test_time_and_turns_need_a_recording(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    for words in (["--at", "3"], ["--turns"]):
        assert main(["explain", *words]) == 2
        assert "name a FILE" in capsys.readouterr().err


def test_recordings_of_this_test_begin_when_recordings_can(run: Recording) -> None:
    assert run.found[0].time_ns == BEGAN_NS
