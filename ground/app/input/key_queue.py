"""Handle keys and pastes in order: each after the effect of the ones before it.

Textual passes a key to the task of a widget, and its effect follows later. Without this queue, a
key that was typed early would go to the screen that was open before. A key with a large effect acts
only at its second press.
"""

from collections import deque
from collections.abc import Awaitable, Callable
from math import inf
from typing import Any, Final, Protocol, TypeAlias, runtime_checkable

from textual import events
from textual.app import App
from textual.command import CommandPalette
from textual.screen import Screen
from textual.widgets import Input

from ground.app.widgets.command_line import insert

Typed: TypeAlias = events.Key | events.Paste
MAX_HELD: Final = 1000
"""A screen opens within milliseconds; more keys than these were not typed by a person."""


class RunBinding(Protocol):
    """Runs the action of a key, if it has one; `priority` ones come before typed text."""

    def __call__(self, key: str, priority: bool = False) -> Awaitable[bool]:
        """Return whether there was an action."""


@runtime_checkable
class TakesKeys(Protocol):
    """A screen with keys that have no binding."""

    def take_key(self, key: str) -> bool:
        """Handle a key; return whether it had an effect."""


class KeyQueue:
    """Keeps input while a screen opens, and handles it one after another."""

    def __init__(self, app: App[Any], run_binding: RunBinding) -> None:
        self._app, self._run_binding = app, run_binding
        self._held: deque[Typed] = deque(maxlen=MAX_HELD)

    @property
    def is_empty(self) -> bool:
        """True while no input waits."""
        return not self._held

    async def take(self, typed: Typed, *, at_once: bool = False) -> None:
        """Handle an input; with `at_once` before all waiting inputs."""
        if at_once or (self.is_empty and is_ready(self._app.screen)):
            await self._handle(typed)
            return
        self._held.append(typed)
        if len(self._held) == 1:
            self._wait()

    def _wait(self) -> None:
        """Continue after the messages that the top screen has already received."""
        screen = self._app.screen
        if not screen.call_later(self._app.call_later, self._release, screen):
            self._app.call_later(self._release, screen)

    async def _release(self, screen: Screen[Any]) -> None:
        """Handle the first waiting input, unless another screen is opening."""
        if self._held and (self._app.screen is screen or is_ready(self._app.screen)):
            await self._handle(self._held.popleft())
        if self._held:
            self._wait()

    async def _handle(self, typed: Typed) -> None:
        """Handle an input completely, by the widget that has the focus now."""
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


CONFIRM_WITHIN_S: Final = 3.0
"""The one gesture of confirmation: the same key, pressed again within this time."""


def confirmation(key: str, what: str) -> str:
    """Return how to confirm what the first press of a key has asked for."""
    return f"press {key} again within {CONFIRM_WITHIN_S:g} s to {what}"


class SecondPress:
    """Notes the first press of a key; the second within `within_s` acts.

    `time_s` returns the time. A press for another `subject` counts as a first one.
    """

    def __init__(self, time_s: Callable[[], float], within_s: float = CONFIRM_WITHIN_S) -> None:
        self._time_s = time_s
        self._within_s = within_s
        self._pressed_s = -inf
        self._subject = ""

    def is_second(self, subject: str = "") -> bool:
        """Note a press; return whether it is the second one."""
        now_s = self._time_s()
        second = subject == self._subject and 0.0 <= now_s - self._pressed_s <= self._within_s
        self._pressed_s, self._subject = -inf if second else now_s, subject
        return second
