"""Make the tab bar: all screens by number and name, and the unread warnings of the log."""

from collections.abc import Callable
from typing import Final

from ground.app.chrome.button_row import Button, buttons_width
from ground.app.screens import SCREENS
from ground.app.widgets.rows import Span, row
from ground.station.history.event_log import EventLog
from protocol.wire.enums import Severity

MAX_COUNT: Final = 99
LOG: Final = "log"
MARKS: Final = ("▌", "▐")
ASCII_MARKS: Final = ("[", "]")
NO_MARKS: Final = (" ", " ")


class UnreadWarnings:
    """Counts the warnings and errors since the log screen was last shown."""

    def __init__(self) -> None:
        self._log: EventLog | None = None
        self._total = 0
        self.count = 0

    def look(self, log: EventLog, *, reading: bool) -> None:
        """Count the new lines of a log; with `reading`, all lines are read now."""
        if log is not self._log:
            self._log, self._total, self.count = log, 0, 0
        if log.total != self._total:
            fresh = log.since(self._total)
            self._total = log.total
            self.count += sum(line.severity <= Severity.WARNING for line in fresh)
        if reading:
            self.count = 0


def tab_buttons(current: str, unread: int, width: int, *, ascii_only: bool = False) -> list[Button]:
    """Return the tabs in the longest form that fits; the current screen always has its name."""
    marks = ASCII_MARKS if ascii_only else MARKS
    warnings = f"▲{min(unread, MAX_COUNT)}" if unread else ""

    def title(name: str) -> str:
        return f"{SCREENS[name]} {name.capitalize()}"

    def number(name: str) -> str:
        return title(name) if name == current else str(SCREENS[name])

    def tabs(word: Callable[[str], str], names: tuple[str, ...]) -> list[Button]:
        return [
            tab(
                name,
                word(name),
                warnings if name == LOG else "",
                marks if name == current else NO_MARKS,
            )
            for name in names
        ]

    everything = tuple(SCREENS)
    forms = (tabs(title, everything), tabs(number, everything), tabs(title, (current,)))
    return next((form for form in forms if buttons_width(form) <= width), forms[-1])


def tab(name: str, words: str, warnings: str, marks: tuple[str, str]) -> Button:
    """Return one tab between two marks."""
    before, after = marks
    spans = row(
        Span(before, "accent"),
        Span(words, "head" if marks == NO_MARKS else "accent"),
        Span(f" {warnings}" if warnings else "", "caution"),
        Span(after, "accent"),
    )
    return Button(spans, f"do('screen-{SCREENS[name]}')")
