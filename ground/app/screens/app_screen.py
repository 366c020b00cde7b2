"""What every screen has: status and alarm above, the command line and the keys below."""

from collections.abc import Callable, Mapping, Sequence
from textwrap import wrap
from typing import ClassVar, Final

from textual.app import ComposeResult
from textual.containers import Container, Horizontal
from textual.screen import Screen
from textual.widgets import Input

from ground.app.input.key_table import KeyBinding, Layer
from ground.app.input.keymap import shown
from ground.app.panels.status import status_row
from ground.app.playback.app_interface import AppInterface
from ground.app.widgets.command_line import CommandLine
from ground.app.widgets.lines import Lines
from ground.app.widgets.rows import Row, Span, cut, row, width_of
from ground.station.station import Station

Action = Callable[[], object]
WIDTHS: Final = ((0, "-tiny"), (60, "-narrow"), (110, "-wide"), (160, "-huge"))
HEIGHTS: Final = ((0, "-low"), (18, "-medium"), (32, "-tall"))
"""Classes of a screen, by the least columns and rows for each."""
MOST_ROWS: Final = 2
STOPS: Final = ("estop-here",)
LAST: Final = ("palette", "help")
ORDER: Final = (
    *("goal", "cursor", "hold", "resume", "arm", "mode", "navigator", "teleop"),
    *("explain", "abort", "missions", "rtl"),
)
"""What every screen has; what only the present one has comes before it."""


class AppScreen(Screen[None]):
    """`key_layers` and `actions` say what keys do here now; `look` draws what has changed."""

    AUTO_FOCUS: ClassVar[str | None] = ""
    focus_first: ClassVar[str] = "#middle"
    key_layer: ClassVar[Layer | None] = None

    def __init__(self, interface: AppInterface) -> None:
        super().__init__()
        self.HORIZONTAL_BREAKPOINTS = list(WIDTHS)
        self.VERTICAL_BREAKPOINTS = list(HEIGHTS)
        self.interface = interface
        self._prompt = ""
        self._then: Callable[[str], None] = interface.run_line

    def compose(self) -> ComposeResult:
        yield Lines(id="status")
        yield Lines(id="alarm")
        with Container(id="middle"):
            yield from self.compose_content()
        with Horizontal(id="typing"):
            yield Lines(id="prompt")
            yield CommandLine(self.interface.complete)
        yield Lines(id="keybar")

    def compose_content(self) -> ComposeResult:
        """What is between the alarm and the command line."""
        yield from ()

    def draw(self) -> None:
        """Show the middle as it is now."""

    def poll(self) -> None:
        """At every round, also when nothing is drawn."""

    def on_mount(self) -> None:
        self.prompt("", self.interface.run_line)
        self.home()

    def home(self) -> None:
        """Nothing is typed: keys are keys."""
        self.set_focus(next(iter(self.query(self.focus_first)), None))

    def on_screen_resume(self) -> None:
        self.redraw()

    def redraw(self) -> None:
        """Draw what has changed since the last look."""
        if not self.is_mounted or not self.size:
            return
        station, width = self.interface.station, self.size.width
        self.lines("status").show([status_row(station, self.interface.session_info, width)])
        alarm = self.lines("alarm")
        rows = alarm_rows(station, width)
        alarm.show(rows)
        alarm.display, alarm.styles.height = bool(rows), max(1, len(rows))
        self.draw()
        self.draw_prompt()
        self.lines("keybar").show([keybar_row(self.interface.keys_now(), width)])

    def lines(self, id: str) -> Lines:
        return self.query_one(f"#{id}", Lines)

    @property
    def command_line(self) -> CommandLine:
        return self.query_one(CommandLine)

    @property
    def typing(self) -> bool:
        return self.focused is self.command_line

    def key_layers(self) -> tuple[Layer, ...]:
        """Which keys count now."""
        if self.typing:
            return (Layer.TYPING, Layer.STATION)
        own = () if self.key_layer is None else (self.key_layer,)
        return (Layer.STOP, *own, Layer.ROBOT, Layer.STATION)

    def actions(self) -> Mapping[str, Action]:
        line = self.command_line
        return {
            "complete": line.complete,
            "history-back": lambda: line.begin(self.interface.recall(line.value, -1)),
            "history-on": lambda: line.begin(self.interface.recall(line.value, 1)),
            "leave-line": self.leave_line,
            "command": lambda: self.ask("", "", self.interface.run_line),
            "goal": lambda: self.ask("", "goal ", self.interface.run_line),
            "next-panel": self.focus_next,
            "panel-before": self.focus_previous,
        }

    # Typing.

    def ask(self, prompt: str, text: str, then: Callable[[str], None]) -> None:
        """Let the operator type a line that begins with `text`."""
        self.prompt(prompt, then)
        self.command_line.begin(text)

    def prompt(self, words: str, then: Callable[[str], None]) -> None:
        """Before the line: what is asked for, or the robot that a command would go to."""
        self._prompt, self._then = words, then
        self.draw_prompt()

    def draw_prompt(self) -> None:
        shown = self._prompt or self.interface.station.robot
        panel = self.lines("prompt")
        panel.show([row(Span(f"{shown}:", "accent"))])
        panel.styles.width = len(shown) + 2

    def leave_line(self) -> None:
        self.command_line.value = ""
        self.prompt("", self.interface.run_line)
        self.home()

    def on_input_submitted(self, event: Input.Submitted) -> None:
        event.stop()
        then, text = self._then, event.value.strip()
        self.leave_line()
        then(text)
        self.redraw()


def alarm_rows(station: Station, width: int) -> list[Row]:
    """The e-stop first; nothing when there is nothing to say."""
    if station.stopping:
        return across(station.stopping, "alarm", width)
    loss = station.loss()
    if loss is not None:
        words = loss.banner(station.now_ns)
        last = f"; last command: {station.last_command}" if station.last_command else ""
        return across(f"{words}{last}", "alarm", width)
    if station.live and not station.ready:
        words = f"reading {station.waiting_for} before commands are taken"
        return across(words, "caution", width)
    return across(station.restarted, "caution", width) if station.restarted else []


def across(words: str, role: str, width: int) -> list[Row]:
    """From edge to edge, in two rows at the most."""
    room = max(1, width - 2)
    lines = wrap(words, room, max_lines=MOST_ROWS, placeholder="…")
    return [cut(row(Span(f" {line}".ljust(width), role)), width) for line in lines]


def keybar_row(keys: Sequence[KeyBinding], width: int) -> Row:
    """As many as there is room for; the way to all the others keeps its place at the end."""
    named = sorted((key for key in keys if key.short and key.keys), key=place)
    tail = [span for key in named if key.id in LAST for span in button(key)]
    room = width - width_of(tuple(tail))
    spans: list[Span] = []
    for key in named:
        more = () if key.id in LAST else button(key)
        room -= width_of(more)
        if room < 0:
            break
        spans += more
    gap = max(0, width - width_of(tuple(spans)) - width_of(tuple(tail)))
    return cut(row(*spans, Span(" " * gap), *tail), width)


def place(key: KeyBinding) -> int:
    if key.id in STOPS:
        return -2
    return ORDER.index(key.id) if key.id in ORDER else -1


def button(key: KeyBinding) -> Row:
    role = "alarm" if key.id in STOPS else "key"
    return row(" ", Span(shown(key.keys[:1]), role), Span(f" {key.short} "))
