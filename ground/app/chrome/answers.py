"""Show the last answer beside the command line for a few seconds, and place Textual's messages."""

from collections.abc import Sequence
from typing import Any, Final

from textual import events
from textual.geometry import Region
from textual.message import Message
from textual.screen import Screen
from textual.widgets._toast import ToastRack

from ground.app.app_interface import AppInterface
from ground.app.input.keymap import KeyBinding, shown
from ground.app.widgets.lines import Lines
from ground.app.widgets.rows import Row, Span, cut, faint, row, width_of
from ground.station.history.event_log import LogLine

SHOWN_S: Final = 5.0
ROLES: Final = {"E": "danger", "W": "caution"}
MARKS: Final = {"E": "▲ ", "W": "▲ "}
MORE: Final = " see Log"
"""The end of an answer that is too long for the line; the log shows all of it."""
LEAST: Final = 40
HINTS: Final = (("goal", "sets a goal"), ("estop-here", "stops"), ("help", "shows all keys"))
"""The hints of the very first start, by the id of their key."""


class AnswerLine(Lines):
    """The last answer beside the command line; a click there begins a command."""

    class Pressed(Message):
        """A click on the answer."""

    def draw(
        self, interface: AppInterface, offered: Sequence[KeyBinding], room: int, *, typing: bool
    ) -> None:
        """Draw the last answer while it is fresh; while a line is typed, in half of the room.

        The hints name keys that are `offered`.
        """
        station = interface.station
        words: Row = ()
        if station.answer is not None and is_fresh(station.answer, station.time_s):
            words = answer_row(station.answer, room // 2 if typing else room)
        elif interface.is_first_start and not typing:
            words = hint_row(offered, room)
        self.styles.width = width_of(words) if typing else room
        self.show([words])

    def on_click(self, event: events.Click) -> None:
        """Ask for a command."""
        event.stop()
        self.post_message(self.Pressed())


def is_fresh(answer: LogLine, now_s: float) -> bool:
    """Return whether an answer is shown at a time of the station."""
    return 0.0 <= now_s - answer.time_s < SHOWN_S


def answer_row(answer: LogLine, width: int) -> Row:
    """Return an answer; a refusal or an error has a mark, not only a colour."""
    letter = answer.letter
    words = Span(MARKS.get(letter, "") + answer.text, ROLES.get(letter, "ok"))
    whole = row(" ", words)
    if width_of(whole) <= width or width < LEAST:
        return cut(whole, width)
    return (*cut(whole, width - len(MORE)), faint(MORE))


def hint_row(offered: Sequence[KeyBinding], width: int) -> Row:
    """Return the hints of the first start, of the keys that are offered."""
    keys = {key.id: shown(key.keys[:1]) for key in offered if key.keys}
    spans = [
        piece
        for id, does in HINTS
        if id in keys
        for piece in (Span(f"  {keys[id]}", "key"), faint(f" {does}"))
    ]
    return cut(row(*spans), width)


MOST: Final = 3
"""Messages that are shown at once; the log has all of them."""
MOST_ROWS: Final = 4
"""Rows of a message at most, with the blank row above it; see ground.tcss."""


class MessagePlace:
    """Keeps messages in a region, where they cover no band, prompt, answer or key bar."""

    def __init__(self) -> None:
        self._placed: tuple[Region, Screen[Any]] | None = None

    def place(self, screen: Screen[Any], region: Region) -> None:
        """Move the messages of a screen into a region, and hide all but the newest few."""
        rack = next((one for one in screen.children if isinstance(one, ToastRack)), None)
        if rack is None:
            return
        if (region, screen) != self._placed:
            self._placed = region, screen
            rack.styles.margin = (region.y, 0, 0, 0)
            rack.styles.max_height = max(1, region.height)
        if rack.display:
            shown = min(MOST, region.height // MOST_ROWS)
            for age, holder in enumerate(reversed(rack.children)):
                holder.display = age < shown
