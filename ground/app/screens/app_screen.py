"""Define what all screens share: status, tabs, alarm, command line and key bar."""

from collections.abc import Callable, Mapping
from functools import partial
from textwrap import wrap
from typing import ClassVar, Final

from textual.app import ComposeResult
from textual.screen import Screen
from textual.widgets import Input

from ground.app.app_interface import AppInterface
from ground.app.chrome.answers import AnswerLine, MessagePlace
from ground.app.chrome.button_row import ButtonRow, buttons_width
from ground.app.chrome.key_bar import NextKey, key_buttons, next_keys, refusal_of
from ground.app.chrome.roster import fits_beside, roster_buttons
from ground.app.chrome.tabs import tab_buttons
from ground.app.input.keymap import KeyBinding, Layer
from ground.app.panels.status import status_row
from ground.app.widgets.command_line import (
    Assist,
    CommandLine,
    candidate_rows,
    no_assistance,
)
from ground.app.widgets.lines import Lines
from ground.app.widgets.rows import Row, Span, cut, row
from ground.app.widgets.strip_widget import StillContainer, StillRow, StillWidget
from ground.commands.command import OperatorCommand
from ground.commands.pose import SetTruePose
from ground.station.station import PLACE_FROM_TRUTH, Station
from protocol.wire.enums import Vehicle

Action = Callable[[], object]
WIDTHS: Final = ((0, "-tiny"), (60, "-narrow"), (110, "-wide"), (160, "-huge"))
HEIGHTS: Final = ((0, "-low"), (18, "-medium"), (32, "-tall"))
"""The style classes of a screen, with the least columns and rows of each."""
MOST_ROWS: Final = 2
HISTORY: Final = "search the history"
POSE: Final = "pose "
"""Start of the commands that set the pose of the robot."""
LEAST_ROWS_FOR_TABS: Final = 10
LEAST_ROWS_FOR_ROSTER: Final = 12


class AppScreen(Screen[None], StillWidget):
    """A screen; `key_layers` and `actions` define its keys, `draw` its content."""

    AUTO_FOCUS: ClassVar[str | None] = ""
    focus_first: ClassVar[str] = "#middle"
    key_layer: ClassVar[Layer | None] = None
    commands_robot: ClassVar[bool] = False
    """True if single keys command the robot here."""

    def __init__(self, interface: AppInterface) -> None:
        super().__init__()
        self.HORIZONTAL_BREAKPOINTS = list(WIDTHS)
        self.VERTICAL_BREAKPOINTS = list(HEIGHTS)
        self.interface = interface
        self._prompt = ""
        self._messages = MessagePlace()
        self._then: Callable[[str], None] = interface.commands.run_line

    def compose(self) -> ComposeResult:
        """Compose status, tabs, alarm, content, command line and key bar."""
        yield Lines(id="status")
        yield ButtonRow(id="tabs")
        yield ButtonRow(id="roster")
        yield Lines(id="alarm")
        with StillContainer(id="middle"):
            yield from self.compose_content()
            yield Lines(id="candidates")
        yield Lines(id="lesson")
        with StillRow(id="typing"):
            yield Lines(id="prompt")
            yield CommandLine(self.interface.commands.assist, self.submit)
            yield AnswerLine(id="answer")
        yield ButtonRow(id="keybar")

    def compose_content(self) -> ComposeResult:
        """Compose what is between the alarm and the command line."""
        yield from ()

    def draw(self) -> None:
        """Draw the content."""

    def poll(self) -> None:
        """Do what is due at every poll, also when no frame is."""

    def on_mount(self) -> None:
        """Show an empty prompt and focus the content."""
        self.prompt("", self.interface.commands.run_line)
        self.home()

    def home(self) -> None:
        """Focus the content, so that keys are actions again; nothing, if it takes no focus."""
        takers = (one for one in self.query(self.focus_first) if one.focusable)
        self.set_focus(next(takers, None))

    def on_screen_resume(self) -> None:
        """Redraw."""
        self.redraw()

    def redraw(self) -> None:
        """Draw what has changed."""
        if not self.is_mounted or not self.size:
            return
        station, width = self.interface.station, self.size.width
        self.lines("status").show([status_row(station, self.interface.session_info, width)])
        self.draw_tabs()
        self.draw_alarm()
        self.draw()
        self.draw_prompt()
        self.draw_candidates()
        self.draw_answer()
        self.draw_lesson()
        keys = key_buttons(self.bar_keys(), width, self.following_keys())
        self.buttons("keybar").show_buttons(*keys)
        self._messages.place(self.app.screen, self.query_one("#middle").region)

    def bar_keys(self) -> list[KeyBinding]:
        """Return the keys for the key bar: with a dialog open, only those that also work in it.

        None that would be refused in the state that is shown.
        """
        keys = self.interface.keys_now()
        if self.app.screen is not self:
            return [key for key in keys if key.layer is Layer.ALWAYS]
        return [key for key in keys if not refusal_of(key, self.interface.station)]

    def following_keys(self) -> tuple[NextKey, ...]:
        """Return the actions that continue from the present state, for the key bar."""
        if not self.commands_robot:
            return ()
        return next_keys(self.interface.station, self.interface.commands.draft_items)

    def draw_lesson(self) -> None:
        """Draw the present step of the tutorial."""
        lesson, words = self.lines("lesson"), self.interface.lesson
        rows = across(words, "reverse", self.size.width) if words else []
        lesson.display, lesson.styles.height = bool(rows), max(1, len(rows))
        lesson.show(rows)

    def draw_answer(self) -> None:
        """Draw the last answer, or the hints of the first start."""
        room = max(0, self.size.width - len(self._prompt or self.interface.station.robot) - 2)
        self.query_one(AnswerLine).draw(self.interface, self.bar_keys(), room, typing=self.typing)

    def take_key(self, key: str) -> bool:
        """Handle a key without a binding; return whether it had an effect."""
        return False

    def close_what_is_open(self) -> None:
        """Close the topmost thing that covers a part of the screen; the screens say what it is."""

    def draw_alarm(self) -> None:
        """Draw the alarm and the band, and colour the frame while the robot is stopped."""
        alarm, band = self.lines("alarm"), self.interface.stop_band(*self.size)
        alarms = alarm_rows(self.interface.station, self.size.width, self.place_steps())
        rows = [*alarms, *band.rows]
        alarm.show(rows)
        alarm.display, alarm.styles.height = bool(rows), max(1, len(rows))
        self.set_class(band.stopped is Vehicle.EMERGENCY_STOP, "-estop")
        self.set_class(band.stopped is Vehicle.FAILSAFE, "-failsafe")

    def draw_tabs(self) -> None:
        """Draw the tab bar with the roster, unless the terminal is too low for them."""
        tabs, roster, width = self.buttons("tabs"), self.buttons("roster"), self.size.width
        tabs.display = self.size.height >= LEAST_ROWS_FOR_TABS
        unread, ascii_only = self.interface.unread_warnings, self.interface.ascii_only
        left = tab_buttons(self.name_of(), unread, width, ascii_only=ascii_only)
        entries, room = self.interface.station.roster(), width - buttons_width(left)
        beside = fits_beside(entries, room)
        robots = roster_buttons(entries, room if beside else width, ascii_only=ascii_only)
        tabs.show_buttons(left, robots if beside else ())
        high = self.size.height >= LEAST_ROWS_FOR_ROSTER
        roster.display = bool(robots) and high and not beside
        roster.show_buttons(robots)

    def name_of(self) -> str:
        """Return the name of this screen."""
        return type(self).__name__.removesuffix("Screen").lower()

    def buttons(self, id: str) -> ButtonRow:
        """Return the row of buttons with this id."""
        return self.query_one(f"#{id}", ButtonRow)

    def lines(self, id: str) -> Lines:
        """Return the panel with this id."""
        return self.query_one(f"#{id}", Lines)

    @property
    def command_line(self) -> CommandLine:
        """The command line."""
        return self.query_one(CommandLine)

    @property
    def typing(self) -> bool:
        """True while the command line has the focus; False before the screen has its widgets."""
        return isinstance(self.focused, CommandLine)

    def key_layers(self) -> tuple[Layer, ...]:
        """Return the layers of keys that are active now."""
        if self.typing:
            return (Layer.TYPING, Layer.STATION)
        own = () if self.key_layer is None else (self.key_layer,)
        robot = (Layer.ROBOT,) if self.commands_robot else ()
        return (Layer.STOP, *own, *robot, Layer.FLEET, Layer.STATION)

    def actions(self) -> Mapping[str, Action]:
        """Return the actions that are possible now, by id."""
        line = self.command_line
        return {
            "complete": line.complete,
            "complete-before": partial(line.complete, -1),
            "history-back": partial(self.recall, -1),
            "history-on": partial(self.recall, 1),
            "history-search": self.search_history,
            "leave-line": self.close_completion_or_line,
            "close": self.close_what_is_open,
            "command": lambda: self.ask("", "", self.interface.commands.run_line),
            "goal": lambda: self.ask("", "goal ", self.interface.commands.run_line),
            "place": self.ask_place,
            "next-panel": self.focus_next,
            "panel-before": self.focus_previous,
        }

    # The command line.

    def ask_place(self) -> None:
        """Let the operator set the pose of the robot; in a simulation offer the true one."""
        if self.interface.station.place_remedy == PLACE_FROM_TRUTH:
            self.offer(SetTruePose(), PLACE_FROM_TRUTH)
        else:
            self.ask("", "pose set ", self.interface.commands.run_line)

    def offer(self, command: OperatorCommand, line: str) -> None:
        """Let the operator confirm a command, or change its line."""
        commands = self.interface.commands

        def take(typed: str) -> None:
            if typed == line:
                commands.perform(command)
            else:
                commands.run_line(typed)

        self.ask("", line, take)

    def place_steps(self) -> str:
        """Return the keys and commands that set the position of the robot."""
        key_shown = self.interface.key_shown
        is_true = self.interface.station.place_remedy == PLACE_FROM_TRUTH
        entered = "Enter sets its true pose" if is_true else "X Y DEG and Enter set its pose"
        if self.typing and self.command_line.value.startswith(POSE):
            return entered
        steps = [key_shown("place"), entered]
        if steps[0].startswith(":"):  # the key is unbound
            steps[0] = f":{POSE}{'truth' if is_true else 'set'}"
        if self.typing:
            steps.insert(0, key_shown("leave-line"))
        elif not self.commands_robot:
            steps.insert(0, f"{key_shown('screen-1')} Drive")
        return ", then ".join(steps)

    def ask(
        self, prompt: str, text: str, then: Callable[[str], None], assist: Assist | None = None
    ) -> None:
        """Let the operator type a line that begins with `text`; `then` gets it.

        `assist` completes the line; a line without a prompt is a command.
        """
        self.prompt(prompt, then)
        usual = no_assistance if prompt else self.interface.commands.assist
        self.command_line.begin(text, assist or usual)

    def draw_candidates(self) -> None:
        """Draw the completions above the command line."""
        panel, line = self.lines("candidates"), self.command_line
        room = self.query_one("#middle").size.height
        rows = candidate_rows(line.candidates, line.chosen, self.size.width, room)
        panel.display = bool(rows) and self.typing
        if panel.display:
            panel.styles.height = len(rows)
            panel.show(rows)

    def recall(self, step: int) -> None:
        """Go through the completions while one is chosen, else through the earlier lines.

        After the newest line, the completions follow.
        """
        line = self.command_line
        if line.chosen is not None:
            line.complete(step)
            return
        found = self.interface.commands.recall(line.value, step)
        if step > 0 and found == line.value:
            line.complete()
        else:
            line.begin(found)

    def search_history(self) -> None:
        """Let the operator search the earlier lines; Enter takes one to the command line."""
        search = self.interface.commands.search

        def take(words: str) -> None:
            found = search(words).candidates
            line = (
                words if any(words == one.line for one in found) else found[0].line if found else ""
            )
            self.ask("", line or words, self.interface.commands.run_line)

        self.ask(HISTORY, self.command_line.value, take, search)

    def prompt(self, words: str, then: Callable[[str], None]) -> None:
        """Show what to type; without `words`, the robot that gets the command."""
        self._prompt, self._then = words, then
        self.draw_prompt()

    def draw_prompt(self) -> None:
        """Draw the prompt."""
        shown = self._prompt or self.interface.station.robot
        panel = self.lines("prompt")
        panel.show([row(Span(f"{shown}:", "accent"))])
        panel.styles.width = len(shown) + 2

    def close_completion_or_line(self) -> None:
        """Drop the chosen completion; without one, leave the command line."""
        if not self.command_line.drop_choice():
            self.leave_line()

    def leave_line(self) -> None:
        """Clear the command line and focus the content."""
        self.command_line.value = ""
        self.prompt("", self.interface.commands.run_line)
        self.home()

    def on_input_changed(self, event: Input.Changed) -> None:
        """Show the completions of the new text."""
        event.stop()
        self.draw_candidates()

    def on_answer_line_pressed(self) -> None:
        """Begin a command where the answer was clicked."""
        self.ask("", "", self.interface.commands.run_line)

    def submit(self, line: str) -> None:
        """Pass on the line that was typed."""
        then = self._then
        self.leave_line()
        then(line.strip())
        self.redraw()


def alarm_rows(station: Station, width: int, place_steps: str) -> list[Row]:
    """Return the most urgent alarm, an emergency stop first; no rows without an alarm.

    `place_steps` are the keys and commands that set the position of the robot.
    """
    if station.stopping:
        return across(station.stopping, "alarm", width)
    loss = station.loss()
    if loss is not None:
        words = loss.banner(station.now_ns)
        last = f"; last command: {station.queue.last}" if station.queue.last else ""
        return across(f"{words}{last}", "alarm", width)
    if station.live and not station.ready:
        words = f"reading {station.waiting_for}, commands are refused until then"
        return across(words, "caution", width)
    words = station.restarted
    if station.place_remedy:
        place = f"PLACE UNKNOWN of {station.robot}: it refuses goals"
        place += f". {place_steps}" if station.live else ""
        words = f"{place}; {words}" if words else place
    return across(words, "caution", width) if words else []


def across(words: str, role: str, width: int) -> list[Row]:
    """Return a coloured text across the whole width, in two rows at most."""
    room = max(1, width - 2)
    lines = wrap(words, room, max_lines=MOST_ROWS, placeholder="…")
    return [cut(row(Span(f" {line}".ljust(width), role)), width) for line in lines]
