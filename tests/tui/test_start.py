"""The start and the end of the app, and its background jobs."""

import asyncio
import os
import sys
from pathlib import Path
from typing import cast

import pytest

from checks.harness.until import PATIENCE_S
from ground.app import start
from ground.app.app import GroundApp
from ground.app.appearance import Appearance
from ground.app.start import capture_output
from runtime.errors import UserError
from tests.support.app import FakeCommandSink, FakeStation, driving, staged


class StubApp:
    """An app that is open until the heap is frozen."""

    defect = None

    def __init__(self) -> None:
        self.frozen = asyncio.Event()

    async def run_async(self) -> int:
        await asyncio.wait_for(self.frozen.wait(), timeout=PATIENCE_S)
        return 0


def test_open_app_freezes_the_heap(monkeypatch: pytest.MonkeyPatch) -> None:
    app = StubApp()
    monkeypatch.setattr(start, "FREEZE_AFTER_S", 0.0)
    monkeypatch.setattr(start, "freeze_heap", app.frozen.set)
    assert start.run_app(cast(GroundApp, app)) == 0


def test_exit_prints_each_drive_and_the_recording(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    drives, log = {"r1": "reached", "r2": "no goal was set"}, tmp_path / "a.tlog"
    start.print_summary(drives, [log])
    assert capsys.readouterr().out == (
        f"r1: reached\nr2: no goal was set\nrecording: {log} (sidestep replay)\n"
    )
    log.with_suffix(".mcap").touch()
    start.print_summary({}, [log])
    assert capsys.readouterr().out == f"recording: {tmp_path}/a.mcap (sidestep replay)\n"
    other = tmp_path / "of the world before.tlog"
    start.print_summary({}, [other, log, log])
    assert [line.split("/")[-1] for line in capsys.readouterr().out.splitlines()] == [
        "of the world before.tlog (sidestep replay)",
        "a.mcap (sidestep replay)",
    ]
    start.print_summary(drives, [])
    assert "recording" not in capsys.readouterr().out
    monkeypatch.setenv("TEXTUAL_DRIVER", "browser")
    start.print_summary(drives, [log])
    assert capsys.readouterr().out == ""


async def test_a_chosen_theme_is_remembered() -> None:
    async with staged() as stage:
        chosen: list[str] = []
        stage.app.remember_theme = chosen.append
        await stage.press("T")
        await stage.until(lambda: bool(chosen))
        assert chosen == [stage.app.theme] == ["light"]


async def test_commands_of_the_settings_run_at_the_start() -> None:
    commands = FakeCommandSink()
    appearance = Appearance(hz=0.0, startup=("layers trail", "hold"))
    app = GroundApp(driving(FakeStation()), commands, None, appearance)
    async with app.run_test() as pilot:
        await pilot.pause()
        assert commands.given == ["layers trail", "hold"]


async def test_result_of_a_job_is_handed_over() -> None:
    found: list[int] = []
    async with staged() as stage:
        stage.app.run_in_background(lambda: 7, found.append)
        await stage.until(lambda: found)
    assert found == [7]


async def test_expected_error_of_a_job_is_noted() -> None:
    def job() -> int:
        raise UserError("no such world")

    async with staged() as stage:
        stage.app.run_in_background(job, lambda _: None)
        await stage.until(lambda: "no such world" in stage.log())


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
