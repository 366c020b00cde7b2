"""Handle keys and pastes in their order: each by what is open when the ones before are done.

Textual passes a key on to the task of a widget, and its effect comes later. A key that was typed
ahead would then be handled by what was open before.
"""

from collections import deque
from collections.abc import Awaitable
from typing import Any, Final, Protocol, TypeAlias, runtime_checkable

from textual import events
from textual.app import App
from textual.command import CommandPalette
from textual.screen import Screen
from textual.widgets import Input

from ground.app.widgets.command_line import insert

Typed: TypeAlias = events.Key | events.Paste
MAX_HELD: Final = 1000
"""A screen opens within milliseconds; more is no typing."""


class RunBinding(Protocol):
    """Runs the action of a key, if it has one; `priority` ones come before typed text."""

    def __call__(self, key: str, priority: bool = False) -> Awaitable[bool]:
        """Return whether there was one."""


@runtime_checkable
class TakesKeys(Protocol):
    """A screen with keys that have no binding."""

    def take_key(self, key: str) -> bool:
        """Handle a key; return whether it had an effect."""


class KeyQueue:
    """Holds what is typed while a screen opens, and handles one after the other."""

    def __init__(self, app: App[Any], run_binding: RunBinding) -> None:
        self._app, self._run_binding = app, run_binding
        self._held: deque[Typed] = deque(maxlen=MAX_HELD)

    @property
    def is_empty(self) -> bool:
        """True while nothing is held."""
        return not self._held

    async def take(self, typed: Typed, *, at_once: bool = False) -> None:
        """Handle what was typed; with `at_once` before all that is held."""
        if at_once or (self.is_empty and is_ready(self._app.screen)):
            await self._handle(typed)
            return
        self._held.append(typed)
        if len(self._held) == 1:
            self._wait()

    def _wait(self) -> None:
        """Go on behind all messages that the top screen has received, as those that open it."""
        screen = self._app.screen
        if not screen.call_later(self._app.call_later, self._release, screen):
            self._app.call_later(self._release, screen)

    async def _release(self, screen: Screen[Any]) -> None:
        """Handle the first that is held, unless another screen opens meanwhile."""
        if self._held and (self._app.screen is screen or is_ready(self._app.screen)):
            await self._handle(self._held.popleft())
        if self._held:
            self._wait()

    async def _handle(self, typed: Typed) -> None:
        """Handle what was typed completely, by what has the focus now."""
        screen, line = self._app.screen, self._app.focused
        if isinstance(typed, events.Paste):
            if isinstance(line, Input):
                insert(line, typed.text)
        elif await self._run_binding(typed.key, priority=True):
            pass
        elif isinstance(line, Input) and typed.character and typed.is_printable:
            line.replace(typed.character, *line.selection)
        elif not (isinstance(screen, TakesKeys) and screen.take_key(typed.key)):
            await self._run_binding(typed.key)


def is_ready(screen: Screen[Any]) -> bool:
    """Return whether a screen has its widgets, and the palette the focus on its line."""
    return screen.is_mounted and not (isinstance(screen, CommandPalette) and screen.focused is None)
