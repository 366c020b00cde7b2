"""`up`, `ps` and `record`: recorders, their problems, and the runs that are here."""

import json
import os
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from ground.cli.main import main, parse
from ground.cli.observe.record import LAST_FRAMES_NS, PAUSE_NS, REPEAT_NS, Alarms, await_pause
from ground.cli.run.up import await_complete_records, await_records, progress_display
from ground.launch.scenario import Scenario, run_of, scenario_of
from ground.text.output import Output
from ground.text.wording import Part
from runtime.clock import ManualClock
from tests.support.each import each
from tests.support.ground.client import captured_output
from tests.support.ground.runs import ENDPOINT, written


@pytest.fixture
def state(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))


@pytest.mark.usefixtures("state")
def test_without_a_run_it_names_the_command_that_starts_one(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(["ps"]) == 0
    assert capsys.readouterr().out == "nothing runs here. Start it: sidestep up\n"


def test_a_user_without_a_home_goes_on(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """As in a container whose user is a number that no list knows."""

    def home() -> Path:
        raise RuntimeError("Could not determine home directory.")

    monkeypatch.delenv("XDG_STATE_HOME", raising=False)
    monkeypatch.delenv("XDG_CONFIG_HOME", raising=False)
    monkeypatch.setattr(Path, "home", home)
    assert main(["ps"]) == 0
    assert main(["config", "path"]) == 0
    assert capsys.readouterr().out.splitlines() == [
        "nothing runs here. Start it: sidestep up",
        "/.config/sidestep/config.toml",
    ]


@pytest.mark.usefixtures("state")
def test_each_run_is_a_line(capsys: pytest.CaptureFixture[str]) -> None:
    written()
    written("tcp/127.0.0.1:1", "a_longer_world")
    assert main(["ps"]) == 0
    head, *lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 2
    for name in ("NAME", "SINCE", "ROBOTS", "WORLD", "ENDPOINT", "PROCESSES"):
        at = head.index(name)
        assert all(line[at] != " " and (at == 0 or line[at - 1] == " ") for line in lines)
    assert ENDPOINT in lines[0]
    assert lines[0].endswith(f"up {os.getpid()}, plant 5")


@pytest.mark.usefixtures("state")
def test_json_has_every_fact(capsys: pytest.CaptureFixture[str]) -> None:
    written()
    main(["ps", "--json"])
    (row,) = json.loads(capsys.readouterr().out)["runs"]
    assert (row["name"], row["endpoint"], row["robots"]) == ("box", ENDPOINT, ["r1"])
    assert (row["world"], row["pid"], row["processes"]) == ("box", os.getpid(), {"plant": 5})


@pytest.mark.usefixtures("state")
def test_a_corrupt_file_is_reported(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = written().path
    assert file is not None
    file.write_text("{")
    assert main(["ps", "--json"]) == 0
    done = capsys.readouterr()
    assert f"{file}: is not a runtime file" in done.err
    assert json.loads(done.out)["ignored"][0]["file"] == str(file)


def log(trouble: str = "", dropped: int = 0) -> Any:
    return SimpleNamespace(error=trouble, dropped=dropped, drop_reason="the disk took too long")


def test_write_error_is_reported_at_once_repeated_and_ended() -> None:
    output, printed = captured_output()
    alarms = Alarms(output)
    for at_ns in (0, 1, REPEAT_NS - 1, REPEAT_NS, REPEAT_NS + 1):
        alarms.look(log("No space left on device"), at_ns)
    alarms.look(log(), REPEAT_NS + 2)
    trouble = "RECORDING FAILS: No space left on device; the robot drives on"
    goes_on = "RECORDING resumed: the log can be written again"
    assert printed()[1].splitlines() == [trouble, trouble, goes_on]


def test_dropped_frames_are_reported_with_their_number() -> None:
    output, printed = captured_output()
    alarms = Alarms(output)
    for at_ns, dropped in ((0, 0), (1, 7), (2, 9), (REPEAT_NS + 1, 9), (3 * REPEAT_NS, 9)):
        alarms.look(log(dropped=dropped), at_ns)
    assert printed()[1].splitlines() == [
        "RECORDING HAS LOST 7 frames: the disk took too long",
        "RECORDING HAS LOST 9 frames: the disk took too long",
    ]


class FramesUnderWay(ManualClock):
    """A clock, and a log that takes a frame in each of the first `rounds` sleeps."""

    def __init__(self, rounds: int) -> None:
        super().__init__()
        self.taken, self._rounds = 0, rounds

    def sleep_until(self, deadline_ns: int) -> None:
        self.taken += self.taken < self._rounds
        super().sleep_until(deadline_ns)


@each(("rounds", "sleeps"), [(0, 1), (3, 4), (1000, LAST_FRAMES_NS // PAUSE_NS)])
def test_frames_under_way_are_taken_before_the_log_is_closed(rounds: int, sleeps: int) -> None:
    clock: Any = FramesUnderWay(rounds)
    await_pause(clock, clock)
    assert clock.now_ns() == sleeps * PAUSE_NS


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
    return scenario_of(options, run_of(options))


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


@each(("in_lines", "every_s"), [(False, 5), (True, 10)])
def test_progress_is_a_line_every_few_seconds(
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
