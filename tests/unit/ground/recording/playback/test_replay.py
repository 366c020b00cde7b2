"""`replay --plain`: texts and states of the robot in order of time."""

import json
from pathlib import Path

import pytest

from ground.cli.main import main, parse
from ground.cli.observe.replay import show_lines
from ground.recording.playback import ReplayBus
from ground.text.output import Output
from protocol.topics import MARK
from protocol.wire.enums import Severity
from protocol.wire.statustext import pieces_of
from runtime.clock import ManualClock
from tests.support.ground.recording.made import START_US, TopicEncoder, mcap, run


@pytest.fixture
def log(tmp_path: Path) -> str:
    frames_sent = list(run(60))
    (remark,) = pieces_of("a cart", 1, Severity.NOTICE)
    frames_sent.insert(200, TopicEncoder().publish(MARK, remark, frames_sent[199].time_us))
    return str(mcap(tmp_path / "a.mcap", frames_sent))


def test_replay_prints_a_line_a_second_with_texts(
    log: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["replay", log, "--plain"]) == 0
    *lines, last = capsys.readouterr().out.splitlines()
    times = [float(line.split()[0]) for line in lines]
    assert times == sorted(times)
    assert [time for time in times if time == int(time)] == [0.0, 1.0, 2.0, 3.0, 3.0]
    assert any("goal: goal 5.40 2.00" in line for line in lines)
    assert any("mark: a cart" in line for line in lines)
    assert "outcome: REACHED" in "\n".join(lines)
    assert lines[-2].endswith("robot: goal reached")
    assert "ACTIVE GUIDED REACHED" in lines[-1]
    assert last.endswith("frames of r1 in 3.0 s")


def test_replay_at_an_instant_shows_earlier_values(
    log: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["replay", log, "--plain", "--at", "2.5"]) == 0
    first = capsys.readouterr().out.splitlines()[0]
    assert first.startswith("    2.50  ACTIVE GUIDED DRIVING  pose 1.0")


def test_replay_json_lists_the_contents(log: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["replay", log, "--json"]) == 0
    reported = json.loads(capsys.readouterr().out)
    assert reported["duration_s"] == 3.0
    assert [mark["kind"] for mark in reported["marks"]] == ["goal", "mark", "outcome"]
    assert reported["facts"] == ["world"]


def test_replay_speed_sets_its_duration(log: str, capsys: pytest.CaptureFixture[str]) -> None:
    clock = ManualClock()
    options = parse(["replay", log, "--plain", "--speed", "2"])
    assert show_lines(options, Output(as_json=False), clock) == 0
    assert clock.now_ns() == 1_500_000_000
    capsys.readouterr()


def test_damaged_file_is_replayed_to_the_damage(
    log: str, capsys: pytest.CaptureFixture[str]
) -> None:
    whole = Path(log).read_bytes()
    Path(log).write_bytes(whole[: len(whole) // 2])
    assert main(["replay", log]) == 1
    assert "DAMAGED" in capsys.readouterr().out.splitlines()[-1]


def test_navigator_needs_re_execute(log: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["replay", log, "--navigator", "bug"]) == 2
    assert "needs --re-execute" in capsys.readouterr().err


def test_re_execute_runs_in_a_process(log: str, capfd: pytest.CaptureFixture[str]) -> None:
    assert main(["replay", log, "--re-execute"]) == 2
    assert "cannot be re-executed: it holds no inputs of control ticks" in capfd.readouterr().err


def test_start_is_the_time_of_the_first_frame(log: str) -> None:
    assert ReplayBus(Path(log), ManualClock()).log_index.start_ns == START_US * 1000


@pytest.mark.parametrize(("large", "frames_sent"), [(0, True), (1 << 40, False)])
def test_large_file_is_announced_before_reading(
    log: str,
    large: int,
    frames_sent: bool,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("ground.cli.observe.replay.LARGE_BYTES", large)
    assert main(["replay", log, "--json"]) == 0
    assert capsys.readouterr().err.startswith(f"reading {log}, ") is frames_sent
