"""`up --record` waits for its recorders before the goals are sent and after the drive."""

import os
from pathlib import Path

import pytest

from ground.cli.main import parse
from ground.cli.run.up import await_complete_records, await_records, progress_display
from ground.launch.child_command import command
from ground.launch.scenario import Scenario, scenario_of, world_facts, world_query
from ground.text.output import Output
from ground.text.status_parts import Part
from runtime.clock import ManualClock
from tests.support.each import each


class Recorders:
    """Write a frame into their logs at some time; counts how often the children are looked at."""

    def __init__(self, clock: ManualClock, logs: list[Path], at_s: float) -> None:
        self.clock, self.logs, self.at_s = clock, logs, at_s
        self.checks = 0

    def __call__(self) -> None:
        self.checks += 1
        if self.clock.now_ns() >= self.at_s * 1e9:
            for log in self.logs:
                log.write_bytes(b"frame")


def recorded(folder: Path, *words: str) -> Scenario:
    options = parse(["up", "--record", str(folder), *words])
    return scenario_of(options, world_facts(command(world_query(options), os.getpid())))


def waited(scenario: Scenario, logs: list[Path], at_s: float, recordings: list[Path]) -> float:
    """Return the seconds until the goal was sent."""
    clock = ManualClock()
    recorders = Recorders(clock, logs, at_s)
    await_records(scenario, lambda: recordings, clock, recorders, Output(as_json=False))
    assert recorders.checks > 0
    return clock.now_ns() / 1e9


def test_navigator_for_studies_only_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        parse(["up", "--navigator", "oracle_grid"])
    assert "oracle_grid is for studies only and no robot has it" in capsys.readouterr().err


def test_the_drive_begins_when_the_first_frame_is_written(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log = tmp_path / "a.tlog"
    log.touch()
    assert waited(recorded(tmp_path), [log], 0.4, [log]) == pytest.approx(0.4, abs=0.1)
    assert capsys.readouterr().err == ""


def test_every_robot_must_be_recorded(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    two = recorded(tmp_path, "--robots", "2")
    logs = [tmp_path / "a.tlog", tmp_path / "b.tlog"]
    assert waited(two, logs[:1], 0.0, logs) == pytest.approx(10.0, abs=0.1)
    assert "no recorder has written" in capsys.readouterr().err
    assert waited(two, logs, 0.0, logs) < 0.1


@pytest.mark.parametrize("content", [b"", b"of another run"])
def test_an_empty_log_and_that_of_another_run_do_not_count(
    tmp_path: Path, content: bytes, capsys: pytest.CaptureFixture[str]
) -> None:
    log = tmp_path / "a.tlog"
    log.write_bytes(content)
    assert waited(recorded(tmp_path), [], 0.0, [] if content else [log]) >= 10.0
    assert f"no recorder has written to {tmp_path} yet" in capsys.readouterr().err


class GrowingLog(ManualClock):
    """A clock; a recorder that is behind adds a frame to a log, in each call until `until_s`."""

    def __init__(self, log: Path, until_s: float) -> None:
        super().__init__()
        self._log, self._until_ns = log, until_s * 1e9

    def sleep_until(self, deadline_ns: int) -> None:
        if deadline_ns <= self._until_ns:
            self._log.write_bytes(self._log.read_bytes() + b"frame")
        super().sleep_until(deadline_ns)


@pytest.mark.parametrize(("until_s", "end_s"), [(0.0, 0.5), (2.0, 2.5), (60.0, 5.0)])
def test_the_end_of_a_lockstep_run_waits_for_a_slow_recorder(
    tmp_path: Path, until_s: float, end_s: float
) -> None:
    log = tmp_path / "a.tlog"
    log.touch()
    clock = GrowingLog(log, until_s)
    await_complete_records([log], clock)
    assert clock.now_ns() / 1e9 == pytest.approx(end_s, abs=0.05)


@each(("in_lines", "every_s"), [(False, 5), (True, 1)])
def test_progress_is_a_line_every_few_seconds_or_every_second(
    capsys: pytest.CaptureFixture[str], *, in_lines: bool, every_s: int
) -> None:
    clock = ManualClock()
    show = progress_display(Output(as_json=False), clock, in_lines=in_lines)
    for number in range(101):
        show([Part(f"driving {number}")])
        clock.advance(100_000_000)
    lines = capsys.readouterr().err.splitlines()
    assert lines == [f"driving {10 * every_s * number}" for number in range(10 // every_s + 1)]


def test_plain_progress_never_rewrites_a_line(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    output = Output(as_json=False)
    monkeypatch.setattr(output, "live", True)
    progress_display(output, ManualClock(), in_lines=True)([Part("driving")])
    assert capsys.readouterr().err == "driving\n"


def test_a_wrong_speed_is_refused_with_the_word_max(capsys: pytest.CaptureFixture[str]) -> None:
    for text in ("fast", "0", "-1"):
        with pytest.raises(SystemExit):
            parse(["up", f"--speed={text}"])
        assert "give a number above 0, or max" in capsys.readouterr().err
