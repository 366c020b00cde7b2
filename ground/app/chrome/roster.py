"""Make the roster: all robots, those that need attention first; a click selects one.

Robots that have no room are counted by their state.
"""

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from typing import Final, NamedTuple

from ground.app.chrome.button_row import Button, buttons_width
from ground.app.chrome.tabs import ASCII_MARKS, MARKS
from ground.app.panels.aged import live
from ground.app.widgets.rows import Row, Span, faint, row, width_of
from ground.map.canvas import hue_of
from ground.station.fleet import Attention, RosterEntry
from ground.text.wording import CAUTION, DANGER, state_role
from protocol.wire.enums import GoalState

ENTRY: Final = 18
"""Columns of a robot with its state, by which the place of the roster is chosen."""
LEAST: Final = 4
"""Columns of a robot besides its name: two marks, its state and a blank."""
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
    """Return the robots in the longest form that fits, else as many as fit before their counts.

    Return nothing for a single robot.
    """
    if len(entries) < 2:
        return []
    marks = ASCII_MARKS if ascii_only else MARKS
    if sum(len(entry.robot) + LEAST for entry in entries) <= width:
        full = [_button(entry, marks, distance=True) for entry in entries]
        short = [_button(entry, marks, distance=False) for entry in entries]
        hint = Button(row(faint(SWITCH)))
        for form in ([*full, hint], full, short):
            if buttons_width(form) <= width:
                return form
    counts = next((one for one in _counts(entries) if width_of(one) <= width), ())
    others = (_button(entry, marks, distance=False) for entry in entries)
    return [*_fitting(others, width - width_of(counts)), Button(counts)]


def _fitting(buttons: Iterable[Button], room: int) -> Iterator[Button]:
    """Yield the first buttons that fit."""
    for one in buttons:
        room -= buttons_width([one])
        if room < 0:
            return
        yield one


def _counts(entries: Sequence[RosterEntry]) -> Iterator[Row]:
    """Yield the numbers of robots by state, then without the first states, and so on.

    Robots that need attention come last, the most urgent ones at the end.
    """
    counts = Counter(state_of(entry) for entry in entries)
    states = sorted(counts, key=lambda state: (-state.attention, -counts[state], state.words))
    for first in range(len(states)):
        spans = [Span(f"{counts[one]} {one.words}", one.role) for one in states[first:]]
        commas = row(faint(" "), *[faint(", ")] * (len(spans) - 1))
        yield tuple(part for pair in zip(commas, spans, strict=True) for part in pair)


class State(NamedTuple):
    """A state by which robots are counted, with the role of its colour."""

    attention: Attention
    words: str
    role: str = "head"


COUNTED: Final = {
    Attention.STOPPED: State(Attention.STOPPED, "stopped", "alarm"),
    Attention.STUCK: State(Attention.STUCK, "stuck", DANGER),
    Attention.LOST: State(Attention.LOST, "lost", DANGER),
    Attention.UNPLACED: State(Attention.UNPLACED, "without a place", CAUTION),
}
CALM: Final = {
    GoalState.NONE.name.lower(): "without a goal",
    **dict.fromkeys(("accepted", "avoiding", "aligning"), "driving"),
}


def state_of(entry: RosterEntry) -> State:
    """Return the state by which a robot is counted."""
    calm = State(entry.attention, CALM.get(entry.words, entry.words))
    return COUNTED.get(entry.attention, calm)


def _button(entry: RosterEntry, marks: tuple[str, str], *, distance: bool) -> Button:
    return Button(_spans(entry, marks, distance=distance), f"app.select_robot({entry.robot!r})")


def _spans(entry: RosterEntry, marks: tuple[str, str], *, distance: bool) -> Row:
    """Return the name in the robot's colour, a mark in that of the state, and what needs attention.

    A stop of a robot that is not selected has the colour of an alarm: it is not handled yet.
    """
    before, after = marks if entry.is_selected else (" ", " ")
    colour = "accent" if entry.is_selected else f"other {hue_of(entry.robot)}"
    name = (Span(before, "accent"), Span(entry.robot, colour))
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
