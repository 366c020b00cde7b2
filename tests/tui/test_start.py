"""Test that an open app freezes the heap."""

import asyncio
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
