"""A key press reaches the bus by few calls: the app performs typed operations, parses nothing."""

import asyncio
import sys
from pathlib import Path
from types import FrameType

import pytest

from ground.app.app import GroundApp
from ground.app.appearance import Appearance
from ground.app.commands.runner import CommandRunner
from ground.client.connection import Common
from ground.console.history import History
from ground.station.robot.background_requests import RequestThread
from protocol.bus.bus import Bus
from protocol.bus.services import Requester
from protocol.topics import COMMAND
from runtime.clock import WallClock
from tests.support.bus.lively import Lively, watching
from tests.support.until import PATIENCE_S

ROOT = Path(__file__).resolve().parents[3]
LIMIT = 15
ACTION = "app.action_do"


def calls(frame: FrameType | None) -> list[str]:
    """Functions of the product on a stack, the innermost first."""
    found = []
    while frame is not None:
        path = Path(frame.f_code.co_filename)
        if path.is_relative_to(ROOT / "ground") or path.is_relative_to(ROOT / "protocol"):
            found.append(f"{path.stem}.{frame.f_code.co_name}")
        frame = frame.f_back
    return found


def test_key_reaches_the_bus_in_fifteen_calls(monkeypatch: pytest.MonkeyPatch) -> None:
    to_thread: list[str] = []
    to_bus: list[str] = []
    start, put = RequestThread.start, Requester._put

    def started(self: RequestThread, job: object) -> bool:
        found = calls(sys._getframe().f_back)
        if not to_bus and ACTION in found:  # outside of it is only what brings keys into order
            to_thread[:] = [*found[: found.index(ACTION) + 1], "start"]
        return start(self, job)  # type: ignore[arg-type]

    def asked(self: Requester, service: object, *how: object, **named: object) -> object:
        if service is COMMAND:
            to_bus[:] = [*calls(sys._getframe().f_back), "put"]
        return put(self, service, *how, **named)  # type: ignore[arg-type]

    monkeypatch.setattr(RequestThread, "start", started)
    monkeypatch.setattr(Requester, "_put", asked)
    with Lively() as stack, stack.going(), watching(stack) as seen:
        seen.until_ready()
        bus = seen.station._bus
        assert isinstance(bus, Bus)
        common = Common(network=bus.network, robot="r1")
        clock = WallClock()
        commands = CommandRunner(lambda: seen.station, bus, common, clock, History())
        app = GroundApp(seen.station, commands, None, Appearance(hz=0.0))

        async def press() -> None:
            async with app.run_test() as pilot, asyncio.timeout(PATIENCE_S):
                await pilot.press("h")
                while not to_bus:
                    await pilot.pause(0.02)

        asyncio.run(press())
        seen.until(lambda: not seen.station.busy)
    assert to_thread
    assert len(to_thread) + len(to_bus) <= LIMIT, " ".join(to_thread + to_bus)
