"""Run an app over a fake station, driven by keys; only the test makes time pass."""

import asyncio
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager
from typing import TypeVar

from textual.pilot import Pilot

from ground.app.app import GroundApp
from ground.app.appearance import Appearance
from ground.app.input.keymap import Keymap
from ground.app.widgets.lines import Lines
from ground.app.widgets.rows import words_of
from tests.support.tui.fakes import FakeCommandSink, FakeStation
from tests.support.tui.underway import driving
from tests.support.until import PATIENCE_S

T = TypeVar("T")


class Stage:
    """The app, its pilot, its station and its command sink."""

    def __init__(
        self, app: GroundApp, pilot: Pilot[int], station: FakeStation, commands: FakeCommandSink
    ):
        self.app, self.pilot, self.station, self.commands = app, pilot, station, commands

    async def press(self, *keys: str) -> None:
        await self.pilot.press(*keys)
        await self.redraw()

    async def redraw(self) -> None:
        """Draw, and let Textual handle the consequences."""
        await self.pilot.pause()
        self.app.redraw()
        await self.pilot.pause()

    async def until(self, condition: Callable[[], object]) -> None:
        """Let Textual work until the condition holds."""
        async with asyncio.timeout(PATIENCE_S):
            while not condition():
                await self.pilot.pause(0.01)

    async def until_shown(self, id: str, text: str) -> None:
        """Draw until a panel of the screen has this text; a screen may still be opening."""
        async with asyncio.timeout(PATIENCE_S):
            while not self.app.screen.query(f"#{id}") or text not in self.words(id):
                await self.redraw()

    async def type(self, text: str) -> None:
        await self.pilot.press(*(NAMES.get(letter, letter) for letter in text))

    def words(self, id: str) -> str:
        """Return the text of a panel."""
        rows = self.app.screen.query_one(f"#{id}", Lines).rows
        return "\n".join(words_of(row) for row in rows)

    def log(self) -> str:
        return "\n".join(line.text for line in self.station.log)


NAMES = {" ": "space", ".": "full_stop", "-": "minus", ":": "colon"}


@asynccontextmanager
async def staged(
    size: tuple[int, int] = (80, 24),
    *,
    station: FakeStation | None = None,
    theme: str = "dark",
    ascii_only: bool = False,
    keymap: Keymap | None = None,
    messages: bool = False,
) -> AsyncIterator[Stage]:
    """Open the app, with a robot on its way unless a station is given.

    `messages` shows Textual's messages.
    """
    station = station or driving(FakeStation())
    commands = FakeCommandSink()
    app = GroundApp(
        station, commands, keymap, Appearance(theme=theme, ascii_only=ascii_only, hz=0.0)
    )
    async with app.run_test(size=size, notifications=messages) as pilot:
        stage = Stage(app, pilot, station, commands)
        await stage.redraw()
        yield stage


def play(story: Callable[[], Awaitable[T]]) -> T:
    """Run an asynchronous test."""

    async def run() -> T:
        return await story()

    return asyncio.run(run())
