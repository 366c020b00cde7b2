"""The app is kept in time once all is there that stays."""

import asyncio
from typing import cast

import pytest

from ground.app import start
from ground.app.app import GroundApp


class Shown:
    """An app that is open until somebody has frozen the heap."""

    defect = None

    def __init__(self) -> None:
        self.frozen = asyncio.Event()

    async def run_async(self) -> int:
        await asyncio.wait_for(self.frozen.wait(), timeout=10.0)
        return 0


def test_no_full_collection_stalls_an_app_that_is_open(monkeypatch: pytest.MonkeyPatch) -> None:
    app = Shown()
    monkeypatch.setattr(start, "FREEZE_AFTER_S", 0.0)
    monkeypatch.setattr(start, "freeze_heap", app.frozen.set)
    assert start.run_app(cast(GroundApp, app)) == 0
