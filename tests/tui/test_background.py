"""Test background jobs, and that only the app writes to the terminal."""

import os
import sys
from pathlib import Path
from threading import Event

import pytest

from ground.app.app import BackgroundJobs
from ground.app.start import capture_output
from runtime.errors import UserError
from tests.support.until import until


def polled(aside: BackgroundJobs, done: Event) -> None:
    def is_done() -> bool:
        aside.poll()
        return done.is_set()

    until(is_done, what="the result of the job")


def test_result_of_a_job_is_handed_over_by_poll() -> None:
    found: list[int] = []
    there = Event()
    aside = BackgroundJobs(found_nothing)

    def done(value: int) -> None:
        found.append(value)
        there.set()

    aside.begin(lambda: 7, done)
    polled(aside, there)
    assert found == [7]


def found_nothing(words: str) -> None:
    raise AssertionError(words)


def test_expected_error_of_a_job_is_noted() -> None:
    said: list[str] = []
    there = Event()

    def note(words: str) -> None:
        said.append(words)
        there.set()

    def job() -> int:
        raise UserError("no such world")

    aside = BackgroundJobs(note)
    aside.begin(job, lambda _: None)
    polled(aside, there)
    assert said == ["no such world"]


def test_other_output_goes_to_the_log_file(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    log = tmp_path / "sub" / "ground.log"
    before = sys.__stdout__, sys.__stderr__
    with capture_output(log):
        os.write(1, b"from a library\n")
        os.write(2, b"panicked at src/lib.rs\n")
        screen = sys.__stderr__
        assert screen is not None
        screen.write("drawn")
        screen.flush()
    os.write(2, b" after")
    assert (sys.__stdout__, sys.__stderr__) == before
    assert capfd.readouterr().err == "drawn after"
    assert log.read_text() == "from a library\npanicked at src/lib.rs\n"


def test_unwritable_log_file_is_ignored(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "file").write_text("")
    with capture_output(tmp_path / "file" / "ground.log"):
        os.write(2, b"lost")
    assert capfd.readouterr().err == ""
