"""Test that an open app freezes the heap."""

import asyncio
from pathlib import Path
from typing import cast

import pytest

from ground.app import start
from ground.app.app import GroundApp


class StubApp:
    """An app that is open until the heap is frozen."""

    defect = None

    def __init__(self) -> None:
        self.frozen = asyncio.Event()

    async def run_async(self) -> int:
        await asyncio.wait_for(self.frozen.wait(), timeout=10.0)
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
