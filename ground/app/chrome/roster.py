"""Make the roster: all robots, those that need attention first; a click selects one."""

from collections.abc import Iterator, Sequence
from typing import Final

from ground.app.chrome.button_row import Button, buttons_width
from ground.app.chrome.tabs import ASCII_MARKS, MARKS
from ground.app.panels.aged import live
from ground.app.widgets.rows import Row, Span, faint, row
from ground.station.fleet import Attention, RosterEntry
from ground.text.wording import CAUTION, DANGER, NEUTRAL, state_role

ENTRY: Final = 18
"""Columns of a robot with its state, by which the place of the roster is chosen."""
SWITCH: Final = "  [ ] switch "
ATTENTION: Final = "▲"
PRESENT: Final = "●"
ABSENT: Final = "○"


def fits_beside(entries: Sequence[RosterEntry], room: int) -> bool:
    """Return whether the roster fits into `room` columns at the end of the tab bar."""
    return len(entries) * ENTRY <= room


def roster_buttons(
    entries: Sequence[RosterEntry], width: int, *, ascii_only: bool = False
) -> list[Button]:
    """Return the robots in the longest form that fits; the last ones may be a number only.

    Return nothing for a single robot.
    """
    if len(entries) < 2:
        return []
    marks = ASCII_MARKS if ascii_only else MARKS
    full = [_button(entry, marks, distance=True) for entry in entries]
    short = [_button(entry, marks, distance=False) for entry in entries]
    hint = Button(row(faint(SWITCH)))
    for form in ([*full, hint], full, short):
        if buttons_width(form) <= width:
            return form
    return list(_first(short, width))


def _first(buttons: Sequence[Button], width: int) -> Iterator[Button]:
    """Yield the first buttons that fit, and the number of the others."""
    room = width - len(f" +{len(buttons)}")
    for place, one in enumerate(buttons):
        room -= buttons_width([one])
        if room < 0:
            yield Button(row(Span(f" +{len(buttons) - place}", NEUTRAL)))
            return
        yield one


def _button(entry: RosterEntry, marks: tuple[str, str], *, distance: bool) -> Button:
    return Button(_spans(entry, marks, distance=distance), f"app.select_robot({entry.robot!r})")


def _spans(entry: RosterEntry, marks: tuple[str, str], *, distance: bool) -> Row:
    """Return the name, a mark in the colour of the state, and what needs attention.

    A stop of a robot that is not selected has the colour of an alarm: it is not handled yet.
    """
    before, after = marks if entry.is_selected else (" ", " ")
    name = (Span(before, "accent"), Span(entry.robot, "accent" if entry.is_selected else "head"))
    role = entry_role(entry)
    if entry.attention is Attention.STOPPED and not entry.is_selected:
        return row(" ", Span(f" {entry.robot} {ATTENTION} {stop_words(entry)} ", "alarm"))
    if entry.needs_attention:
        mark = ABSENT if entry.attention is Attention.LOST else ATTENTION
        return row(*name, Span(after, "accent"), Span(f"{mark} {stop_words(entry)} ", role))
    to_go = "" if entry.goal_distance_m is None else f"{entry.goal_distance_m:.1f} m "
    words = faint(to_go) if distance else Span("")
    return row(*name, Span(after, "accent"), Span(f"{PRESENT} ", role), words)


def stop_words(entry: RosterEntry) -> str:
    """Return the state of a robot that needs attention; stops are in capitals."""
    if entry.attention is not Attention.STOPPED:
        return entry.words
    return entry.words.upper().replace("EMERGENCY STOP", "E-STOP")


def entry_role(entry: RosterEntry) -> str:
    """Return the role of the colour of a robot's state."""
    if entry.attention is Attention.LOST or entry.stopping:
        return DANGER
    status = live(entry.status)
    if status is None or entry.attention is Attention.UNPLACED:
        return CAUTION
    return state_role(status)
