"""The ending of the previous run, from its own mark or from the launcher."""

from pathlib import Path

import pytest

from protocol.wire.enums import Severity
from robot.core.parameters import DEFAULTS
from robot.file_writer import Directory
from robot.process import summary_of
from robot.run import report_previous_run
from robot.storage import (
    HUNG_BEFORE,
    HUNG_NAME,
    NO_REPORT,
    RUN_FILE_NAME,
    RUNNING,
    PreviousRun,
    Store,
)
from robot.vehicle import Vehicle
from runtime.watchdog import Watchdog
from tests.support.each import each
from tests.support.robot.held_writer import HeldWriter

KILLED = "was killed (signal SIGKILL)"


def test_first_run_has_no_previous_one(tmp_path: Path) -> None:
    directory = Directory(tmp_path / "new" / "state")
    assert PreviousRun(directory).begin() == ""
    assert [file.error for file in directory.collect()] == [None]


def test_normal_stop_is_not_reported(tmp_path: Path) -> None:
    first = PreviousRun(Directory(tmp_path))
    first.begin()
    first.end()
    assert PreviousRun(Directory(tmp_path)).begin() == ""


def test_normal_stop_of_an_earlier_version_is_not_reported(tmp_path: Path) -> None:
    (tmp_path / RUN_FILE_NAME).write_text("was told to stop\n")
    assert PreviousRun(Directory(tmp_path)).begin() == ""


def test_killed_run_ends_without_a_report(tmp_path: Path) -> None:
    PreviousRun(Directory(tmp_path)).begin()
    assert PreviousRun(Directory(tmp_path)).begin() == NO_REPORT == "ended without a report"


def test_observation_of_the_launcher_replaces_a_missing_mark(tmp_path: Path) -> None:
    PreviousRun(Directory(tmp_path)).begin()
    assert PreviousRun(Directory(tmp_path)).begin("signal SIGKILL") == KILLED


def test_own_mark_has_priority_over_the_launcher(tmp_path: Path) -> None:
    first, last = (
        PreviousRun(Directory(tmp_path)),
        "ended by a core exception (ZeroDivisionError: x)",
    )
    first.begin()
    first.end(last)
    assert PreviousRun(Directory(tmp_path)).begin("ended by itself (exit code 1)") == last


def test_mark_is_reported_to_the_next_run_only(tmp_path: Path) -> None:
    PreviousRun(Directory(tmp_path)).begin()
    second = PreviousRun(Directory(tmp_path))
    second.begin()
    second.end()
    assert PreviousRun(Directory(tmp_path)).begin() == ""


@each("after", ["signal SIGKILL", KILLED])
def test_without_a_directory_the_launcher_counts(after: str) -> None:
    life = PreviousRun(Directory(None))
    assert life.begin(after) == KILLED
    life.end()
    assert (life.trace, PreviousRun(Directory(None)).begin()) == (None, "")


def test_stack_traces_of_a_hung_run_are_kept(tmp_path: Path) -> None:
    PreviousRun(Directory(tmp_path)).begin()
    (tmp_path / HUNG_NAME).write_text("Current thread ...")
    assert PreviousRun(Directory(tmp_path)).begin() == "hung (its loop did not run for 5 s)"
    assert (tmp_path / HUNG_BEFORE).read_text() == "Current thread ..."
    assert PreviousRun(Directory(tmp_path)).begin() == NO_REPORT


def test_unwritable_directory_is_reported_and_the_robot_runs(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")
    store = Store(tmp_path / "file")
    vehicle, life = Vehicle(DEFAULTS, store), PreviousRun(store.directory)
    assert life.begin("signal SIGKILL") == KILLED
    assert "life not saved: Not a directory" in [text.text for text in vehicle.texts()]
    with Watchdog(trace=life.trace):
        life.end()


def test_marks_are_written_by_the_writer(tmp_path: Path) -> None:
    writer = HeldWriter()
    life = PreviousRun(Directory(tmp_path, writer))
    life.begin()
    life.end("ended by itself")
    assert [(job.path.name, job.text) for job in writer.waiting] == [(RUN_FILE_NAME, RUNNING)]
    assert not (tmp_path / RUN_FILE_NAME).exists()


def test_the_last_mark_is_written_when_the_robot_ends(tmp_path: Path) -> None:
    store = Store(tmp_path, HeldWriter())
    vehicle, life = Vehicle(DEFAULTS, store), PreviousRun(store.directory)
    life.begin()
    life.end("ended by itself")
    vehicle.finish_saving(1.0)
    assert (tmp_path / RUN_FILE_NAME).read_text() == "ended by itself"


def test_invalid_mark_counts_as_none(tmp_path: Path) -> None:
    (tmp_path / RUN_FILE_NAME).write_bytes(b"\xff\xfe\x00")
    assert PreviousRun(Directory(tmp_path)).begin() == ""


def test_ending_is_announced_and_printed(capsys: pytest.CaptureFixture[str]) -> None:
    vehicle = Vehicle(DEFAULTS, Store(None))
    report_previous_run(vehicle, "r1", PreviousRun(Directory(None)), "signal SIGKILL")
    texts = vehicle.texts()
    words = f"restarted: the previous run {KILLED}"
    announced = "".join(text.text for text in texts)
    assert words in announced
    assert max(text.severity for text in texts) == Severity.INFO
    assert min(text.severity for text in texts) == Severity.WARNING
    assert capsys.readouterr().err == f"robot r1: {words}\n"


def test_first_run_announces_nothing(capsys: pytest.CaptureFixture[str]) -> None:
    vehicle = Vehicle(DEFAULTS, Store(None))
    report_previous_run(vehicle, "r1", PreviousRun(Directory(None)), "")
    assert [text.text for text in vehicle.texts()] == ["started: disarmed, standing still"]
    assert capsys.readouterr().err == ""


def test_of_a_long_exception_the_first_line_is_kept() -> None:
    assert summary_of(ValueError("one\ntwo")) == "ValueError: one"
