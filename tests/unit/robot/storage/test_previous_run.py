"""A robot knows how the one before it ended: by its own last word, or by what others saw."""

from pathlib import Path

import pytest

from protocol.wire.enums import Severity
from robot.core.parameters import DEFAULTS
from robot.run import PLACE_UNKNOWN, report_previous_run, summary_of
from robot.storage.files import Store
from robot.storage.previous_run import (
    FILE_NAME,
    HUNG_BEFORE,
    HUNG_NAME,
    NO_REPORT,
    RUNNING,
    PreviousRun,
)
from robot.storage.writer import Directory
from robot.vehicle import Vehicle
from runtime.watchdog import Watchdog
from tests.support.robot.held_writer import HeldWriter

KILLED = "was killed (signal SIGKILL)"


def test_the_first_one_has_nobody_before_it(tmp_path: Path) -> None:
    directory = Directory(tmp_path / "new" / "state")
    assert PreviousRun(directory).begin() == ""
    assert [file.error for file in directory.collect()] == [None]


def test_one_that_was_told_to_stop_is_no_news(tmp_path: Path) -> None:
    first = PreviousRun(Directory(tmp_path))
    first.begin()
    first.end()
    assert PreviousRun(Directory(tmp_path)).begin() == ""


def test_one_that_was_killed_leaves_no_word(tmp_path: Path) -> None:
    PreviousRun(Directory(tmp_path)).begin()
    assert PreviousRun(Directory(tmp_path)).begin() == NO_REPORT == "ended without a report"


def test_what_the_supervisor_saw_is_better_than_no_word(tmp_path: Path) -> None:
    PreviousRun(Directory(tmp_path)).begin()
    assert PreviousRun(Directory(tmp_path)).begin("signal SIGKILL") == KILLED


def test_its_own_last_word_is_better_than_what_others_saw(tmp_path: Path) -> None:
    first, last = (
        PreviousRun(Directory(tmp_path)),
        "ended by a core exception (ZeroDivisionError: x)",
    )
    first.begin()
    first.end(last)
    assert PreviousRun(Directory(tmp_path)).begin("ended by itself (exit code 1)") == last


def test_a_word_is_told_to_the_next_one_only(tmp_path: Path) -> None:
    PreviousRun(Directory(tmp_path)).begin()
    second = PreviousRun(Directory(tmp_path))
    second.begin()
    second.end()
    assert PreviousRun(Directory(tmp_path)).begin() == ""


@pytest.mark.parametrize("after", ["signal SIGKILL", KILLED])
def test_without_a_directory_it_believes_who_starts_it(after: str) -> None:
    life = PreviousRun(Directory(None))
    assert life.begin(after) == KILLED
    life.end()
    assert (life.trace, PreviousRun(Directory(None)).begin()) == (None, "")


def test_one_that_hung_has_left_its_place_which_is_kept(tmp_path: Path) -> None:
    PreviousRun(Directory(tmp_path)).begin()
    (tmp_path / HUNG_NAME).write_text("Current thread ...")
    assert PreviousRun(Directory(tmp_path)).begin() == "hung (its loop did not run for 5 s)"
    assert (tmp_path / HUNG_BEFORE).read_text() == "Current thread ..."
    assert PreviousRun(Directory(tmp_path)).begin() == NO_REPORT


def test_a_directory_that_cannot_be_written_is_told_and_stops_nobody(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")
    store = Store(tmp_path / "file")
    vehicle, life = Vehicle(DEFAULTS, store), PreviousRun(store.directory)
    assert life.begin("signal SIGKILL") == KILLED
    assert "life not saved: Not a directory" in [text.text for text in vehicle.texts()]
    with Watchdog(trace=life.trace):
        life.end()


def test_marks_are_left_to_the_writer(tmp_path: Path) -> None:
    writer = HeldWriter()
    life = PreviousRun(Directory(tmp_path, writer))
    life.begin()
    life.end("ended by itself")
    assert [(job.path.name, job.text) for job in writer.waiting] == [(FILE_NAME, RUNNING)]
    assert not (tmp_path / FILE_NAME).exists()


def test_the_last_mark_is_written_when_the_robot_ends(tmp_path: Path) -> None:
    store = Store(tmp_path, HeldWriter())
    vehicle, life = Vehicle(DEFAULTS, store), PreviousRun(store.directory)
    life.begin()
    life.end("ended by itself")
    vehicle.finish_saving(1.0)
    assert (tmp_path / FILE_NAME).read_text() == "ended by itself"


def test_noise_in_the_file_is_taken_for_no_word(tmp_path: Path) -> None:
    (tmp_path / FILE_NAME).write_bytes(b"\xff\xfe\x00")
    assert PreviousRun(Directory(tmp_path)).begin() == ""


def test_it_is_told_to_everybody_and_on_standard_error(capsys: pytest.CaptureFixture[str]) -> None:
    vehicle = Vehicle(DEFAULTS, Store(None))
    report_previous_run(vehicle, "r1", PreviousRun(Directory(None)), "signal SIGKILL")
    texts = vehicle.texts()
    words = f"restarted: the previous run {KILLED}"
    told = "".join(text.text for text in texts)
    assert words in told
    assert PLACE_UNKNOWN in told
    assert max(text.severity for text in texts) == Severity.INFO
    assert min(text.severity for text in texts) == Severity.WARNING
    assert capsys.readouterr().err == f"robot r1: {words}\nrobot r1: {PLACE_UNKNOWN}\n"


def test_the_first_one_has_nothing_to_tell(capsys: pytest.CaptureFixture[str]) -> None:
    vehicle = Vehicle(DEFAULTS, Store(None))
    report_previous_run(vehicle, "r1", PreviousRun(Directory(None)), "")
    assert [text.text for text in vehicle.texts()] == ["started: disarmed, standing still"]
    assert capsys.readouterr().err == ""


def test_of_a_long_exception_the_first_line_is_kept() -> None:
    assert summary_of(ValueError("one\ntwo")) == "ValueError: one"
