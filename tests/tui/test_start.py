"""Test the start and the end of the app: heap, settings, summary."""

import asyncio
from pathlib import Path
from typing import cast

import pytest

from ground.app import start
from ground.app.app import GroundApp
from ground.app.appearance import Appearance
from tests.support.tui.fakes import FakeCommandSink, FakeStation
from tests.support.tui.pilot import play, staged
from tests.support.tui.underway import driving
from tests.support.until import PATIENCE_S


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
    start.print_summary(drives, log)
    assert capsys.readouterr().out == (
        f"r1: reached\nr2: no goal was set\nrecording: {log} (sidestep replay)\n"
    )
    log.with_suffix(".mcap").touch()
    start.print_summary({}, log)
    assert capsys.readouterr().out == f"recording: {tmp_path}/a.mcap (sidestep replay)\n"
    start.print_summary(drives, None)
    assert "recording" not in capsys.readouterr().out
    monkeypatch.setenv("TEXTUAL_DRIVER", "browser")
    start.print_summary(drives, log)
    assert capsys.readouterr().out == ""


def test_a_chosen_theme_is_remembered() -> None:
    async def story() -> None:
        async with staged() as stage:
            chosen: list[str] = []
            stage.app.remember_theme = chosen.append
            await stage.press("T")
            await stage.until(lambda: bool(chosen))
            assert chosen == [stage.app.theme] == ["light"]

    play(story)


def test_commands_of_the_settings_run_at_the_start() -> None:
    async def story() -> None:
        commands = FakeCommandSink()
        appearance = Appearance(hz=0.0, startup=("layers trail", "hold"))
        app = GroundApp(driving(FakeStation()), commands, None, appearance)
        async with app.run_test() as pilot:
            await pilot.pause()
            assert commands.given == ["layers trail", "hold"]

    play(story)
