"""Show the help: examples, active keys, marks of the map, names in the panels, and commands."""

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import ClassVar, Final, NamedTuple

from textual import events
from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.screen import ModalScreen

from ground.app.app_interface import AppControl
from ground.app.input.keymap import KeyBinding, shown
from ground.app.widgets.lines import Lines
from ground.app.widgets.map import MONO
from ground.app.widgets.rows import Row, Span, faint, row, width_of
from ground.console.parser import help_text, summaries
from ground.map.canvas import DOTTED, HEADINGS, MARKS
from runtime.cli.verb_table import VERBS

COMMANDS: Final = "commands, typed after :"
NAMES: Final = 20
EXAMPLES: Final = (
    ("g 3 1 enter", "drive to x 3 m, y 1 m"),
    ("g 3 1 90 enter", "the same, and end with a heading of 90°"),
    ("G arrows enter", "drive to a place on the map"),
    ("G w arrows w W W", "draft two waypoints, send them, start the mission"),
    ("space", "emergency stop; D D clears it, a arms, r goes on"),
    ("t arrows esc", "drive by hand"),
    ("ctrl+z", "take back the last goal, or change of a parameter, the fence or the draft"),
    (": help goto", "all about one command"),
)
MEANINGS: Final[Mapping[str, str]] = MappingProxyType(
    {
        "seen": "walls and obstacles that the sonars have found",
        "seen late": "the same, found some time ago",
        "goal": "the goal; a line shows its heading",
        "virtual": "virtual goal: where the navigator steers to pass an obstacle",
        "cursor": "the cursor (G, or a click)",
        "hit": "here the robot met an obstacle and began to follow it",
        "leave": "here it left the obstacle again",
        "waypoint": "a waypoint of the robot's mission",
        "draft": "a waypoint that was not sent yet (W sends)",
        "other": "another robot",
        "in need": "another robot that needs attention (! selects it)",
        "mover": "a moving obstacle",
        "dead sonar": "beside the robot: the sonar in this direction gives no reading",
        "lost": "the place of the robot is unknown",
        "reached": "a ghost: ended at the goal",
        "collided": "a ghost: collided",
        "unreachable": "a ghost: it proved that no way leads to the goal",
        "ghost lost": "a ghost: lost, with neither a way nor a proof",
        "stuck": "a ghost: stuck",
        "ended": "a ghost: ended otherwise",
        "bar left": "the scale: this length in metres",
    }
)
"""The meaning of each mark of the map."""
NOTHING_TO_SAY: Final = ("bar", "bar right")
PANELS: Final = (
    ("L79 ... R79", "the eight sonars by their direction: 79° left to 79° right"),
    ("! and !!", "nearer than the avoidance zone; nearer than the guard stops"),
    (">3", "no echo within 3 m, the range of the sonars"),
    ("--", "no value, or one that is too old"),
    ("dead", "no reading in one of the last scans"),
    ("~23 s left", "by the robot's clock: simulated seconds in a simulation, as `driven`"),
    ("γ", "how far the navigator turns the goal's direction, in degrees"),
    ("σ or ±", "doubt of the position, one standard deviation"),
    ("t+", "time since the drive to the goal began"),
    ("cycle≤", "longest control cycle of the last second, of its budget"),
    ("late≤", "latest start of a control cycle in the last second"),
    ("r o n g w", "parts of the cycle in µs: read, odometry, navigate, guard, write"),
    ("SIM 0.8x", "simulated time runs at 0.8 of real time"),
    ("▲2 at 4 Log", "warnings since the log was last shown"),
)
UNITS: Final = (
    ("length", "m; on the map x is to the right and y up"),
    ("heading, angle", "degrees as typed and shown, counter-clockwise from x; rad in files"),
    ("speed", "m/s; negative: backwards"),
    ("turn", "deg/s as typed and shown, positive: left; rad/s in files"),
    ("time", "s; ms in names that end in _ms, µs for parts of a control cycle"),
    ("clock", "local time; its zone is named on the log and in lists"),
    ("doubt", "m and degrees, one standard deviation; the ellipse has 95 %"),
    ("parameter", "the unit beside it on Params, and at the end of its name: _m _rad _m_s _ms"),
)


class Section(NamedTuple):
    """A part of the help with its title."""

    title: str
    rows: list[Row]


def sections(
    keys: Sequence[KeyBinding],
    word: str = "",
    *,
    ascii_only: bool = False,
    is_mono: bool = False,
) -> list[Section]:
    """Return all parts. With a `word`, its command comes first; UserError when there is none."""
    lead = [Section(word, command_rows(word))] if word else []
    return [
        *lead,
        Section("examples", table(EXAMPLES)),
        *key_sections(keys),
        Section("marks on the map", table(mark_pairs(ascii_only=ascii_only, is_mono=is_mono))),
        Section("names in the panels", table(PANELS)),
        Section("units", table(UNITS)),
        Section(COMMANDS, table(tuple(summaries().items()))),
    ]


def key_sections(keys: Sequence[KeyBinding]) -> list[Section]:
    """Return the active keys, one section for each layer."""
    layers = dict.fromkeys(key.layer for key in keys)
    return [
        Section(
            f"keys: {layer.value}",
            table([(shown(key.keys), key.description) for key in keys if key.layer is layer]),
        )
        for layer in layers
    ]


def mark_pairs(*, ascii_only: bool, is_mono: bool) -> list[tuple[str, str]]:
    """Return each mark with its meaning, as the map draws it now; the robot first."""
    form = int(ascii_only)
    robot = ("> ^ < v" if ascii_only else " ".join(HEADINGS[form][::2]), "the robot, by heading")
    marks = {name: MARKS[name][form] for name in MEANINGS}
    meanings = dict(MEANINGS)
    if not (ascii_only or is_mono):  # echoes are dots, and their age is a shade
        marks["seen"] = DOTTED
        meanings["seen"] += "; fainter: some time ago"
        del meanings["seen late"]
    return [robot, *((marks[name], meaning) for name, meaning in meanings.items())]


def table(pairs: Sequence[tuple[str, str]]) -> list[Row]:
    """Return rows of two columns."""
    return [row(Span(f" {left:>{NAMES}}", "key"), Span(f"  {right}")) for left, right in pairs]


def command_rows(word: str) -> list[Row]:
    """Return usage, arguments and example of a command. Raise UserError when it is unknown."""
    rows = [row(f"  {line}") for line in help_text(word).splitlines()]
    example = VERBS[word].example if word in VERBS else ""
    return [*rows, row("  example: ", Span(f":{example}", "key"))] if example else rows


BORDERS: Final = 4
"""Columns of the border and the space beside it."""
HOW: Final = "   arrows scroll, tab: next part, esc closes"


class HelpScreen(ModalScreen[None]):
    """A pane of sections; `at` is the title of the one to begin with. The stop keys work."""

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("up,k", "move(-1)"),
        Binding("down,j", "move(1)"),
        Binding("pageup", "move(-10)"),
        Binding("pagedown", "move(10)"),
        Binding("home", "move(-10000)"),
        Binding("end", "move(10000)"),
        Binding("tab,n", "part(1)"),
        Binding("shift+tab,N", "part(-1)"),
        Binding("escape,q,question_mark,f1,enter", "dismiss"),
    ]
    AUTO_FOCUS = ""

    def __init__(self, sections: Sequence[Section], at: str = "") -> None:
        super().__init__()
        self._rows: list[Row] = []
        self._parts: dict[str, int] = {}
        for title, rows in sections:
            self._parts[title] = len(self._rows)
            how = "" if self._rows else HOW
            self._rows += [row(Span(f" {title}", "accent"), faint(how)), *rows, ()]
        self._top = self._parts.get(at, 0)

    def compose(self) -> ComposeResult:
        """Compose the pane."""
        yield Lines(id="help", classes="box")

    def on_mount(self) -> None:
        """Draw the rows."""
        self.show()

    def on_resize(self) -> None:
        """Draw the rows in the new size."""
        self.show()

    def show(self) -> None:
        """Draw the rows that fit."""
        box = self.query_one(Lines)
        box.styles.height = min(len(self._rows) + 2, max(3, self.size.height - 2))
        widest = max(map(width_of, self._rows), default=0) + BORDERS
        box.styles.width = min(widest, max(10, self.size.width - 2))
        box.show(self._rows[self._top :])

    def action_move(self, step: int) -> None:
        """Scroll by rows."""
        last = max(0, len(self._rows) - self.query_one(Lines).size.height)
        self._top = max(0, min(last, self._top + step))
        self.show()

    def action_part(self, step: int) -> None:
        """Scroll to the next part (1) or the one before (-1)."""
        places = list(self._parts.values())
        there = [at for at in places if (at - self._top) * step > 0]
        if there:
            self._top = there[0] if step > 0 else there[-1]
            self.show()

    def on_mouse_scroll_up(self, event: events.MouseScrollUp) -> None:
        """Scroll up."""
        event.stop()
        self.action_move(-3)

    def on_mouse_scroll_down(self, event: events.MouseScrollDown) -> None:
        """Scroll down."""
        event.stop()
        self.action_move(3)


def show_help(app: AppControl, word: str = "", *, commands: bool = False) -> None:
    """Open the help at one command, at the list of `commands`, or at its begin.

    Raise UserError when the command is unknown.
    """
    mono = app.theme == MONO
    parts = sections(app.keys_now(), word, ascii_only=app.ascii_only, is_mono=mono)
    app.push_screen(HelpScreen(parts, word or (COMMANDS if commands else "")))
