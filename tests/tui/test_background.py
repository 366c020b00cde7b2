"""Slow work beside the screen, and a terminal that belongs to the app alone."""

import os
import sys
from pathlib import Path
from threading import Event

import pytest

from ground.app.background import BackgroundJobs
from ground.app.output_capture import capture_output
from runtime.errors import UserError
from tests.support.until import until


def polled(aside: BackgroundJobs, done: Event) -> None:
    def is_done() -> bool:
        aside.poll()
        return done.is_set()

    until(is_done, what="what comes of it")


def test_what_comes_of_a_job_is_handed_over_when_it_is_polled_for() -> None:
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


def test_an_error_that_is_meant_for_people_is_said() -> None:
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


def test_what_others_write_goes_to_a_file_and_the_terminal_comes_back(
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


def test_a_log_that_cannot_be_written_is_no_reason_to_fail(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "file").write_text("")
    with capture_output(tmp_path / "file" / "ground.log"):
        os.write(2, b"lost")
    assert capfd.readouterr().err == ""
