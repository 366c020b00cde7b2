"""The ground station on a terminal: it samples a station, draws what has changed, and asks."""

import os
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path
from time import monotonic_ns
from typing import TYPE_CHECKING, ClassVar, Final, TypeVar

from textual import events
from textual.app import App, ScreenStackError
from textual.command import Provider
from textual.driver import Driver
from textual.filter import LineFilter
from textual.timer import Timer

from ground.app.appearance import Appearance
from ground.app.background import BackgroundJobs
from ground.app.commands.command_sink import CommandSink
from ground.app.commands.robot_keys import RobotKeys
from ground.app.frame_rate import Drawable, FrameRate
from ground.app.input.bindings import bindings_of
from ground.app.input.key_table import KeyBinding, Layer
from ground.app.input.keymap import Keymap
from ground.app.panels.status import SessionInfo
from ground.app.screens import SCREENS, screen_of
from ground.app.screens.app_screen import Action, AppScreen
from ground.app.themes import THEMES
from ground.app.widgets.printable import Printable
from ground.client.operations import Operation
from ground.client.results import Outcome
from ground.client.telemetry import Age
from ground.console import AppCommand
from ground.map import Target
from ground.station.station import Station
from protocol.topics import HEARTBEAT
from protocol.wire.enums import Severity
from runtime.clock import WallClock

if TYPE_CHECKING:
    from ground.app.playback.player import Player
    from ground.launch.launcher import Stack
    from ground.launch.recording_session import RecordingSession

T = TypeVar("T")
POLL_HZ: Final = 20.0
SETTLED_S: Final = 0.2
"""So long after the terminal's last change of size all of it is painted again."""


def palette() -> "type[Provider]":
    """Imported when it is opened."""
    from ground.app.commands.palette import CommandPalette

    return CommandPalette


class GroundApp(App[int]):
    """Screens, keys and a timer around a station; nothing here knows how a robot is reached."""

    CSS_PATH = Path(__file__).with_name("ground.tcss")
    TITLE = "sidestep"
    DEFAULT_MODE = "drive"
    AUTO_FOCUS = ""
    COMMANDS: ClassVar[set[type[Provider] | Callable[[], type[Provider]]]] = {palette}

    def __init__(
        self,
        station: Station | None,
        commands: CommandSink,
        keymap: Keymap | None = None,
        appearance: Appearance | None = None,
        stack: "Stack | None" = None,
        player: "Player | None" = None,
        recording: "RecordingSession | None" = None,
    ) -> None:
        """Without a `station` it is the player's that is shown on every screen."""
        # Textual takes colours away as the theme is at this moment, and that is not yet ours: what
        # would be left of a terminal's own colours is black on black.
        super().__init__(ansi_color=True if os.environ.get("NO_COLOR") else None)
        self.player = player
        self.recording = recording
        self.appearance = appearance or Appearance()
        self._station, self._commands = station, commands
        self._keymap_in_force = keymap or Keymap()
        self._bindings = bindings_of(self._keymap_in_force)
        self._stack = stack
        self._jobs = BackgroundJobs(self.note)
        self._frame_rate = FrameRate(self.appearance.hz)
        self._settling: Timer | None = None
        self._printable = Printable()
        self._robot_keys = RobotKeys(self)
        for theme in THEMES:
            self.register_theme(theme)
        self.theme = self.appearance.theme
        for name in SCREENS:
            self.add_mode(name, partial(screen_of, name, self))
        self.set_class(self.appearance.ascii_only, "-ascii")

    def on_mount(self) -> None:
        if self._station is None:
            self.switch_mode("replay")
        if self.appearance.hz:
            self.set_interval(1.0 / POLL_HZ, self.sample)

    # As screens see it (Deck).

    @property
    def station(self) -> Station:
        if self._station is not None:
            return self._station
        assert self.player is not None, "there is a robot or a recording"
        return self.player.station

    @property
    def keymap(self) -> Keymap:
        return self._keymap_in_force

    @property
    def ascii_only(self) -> bool:
        return self.appearance.ascii_only

    @property
    def session_info(self) -> SessionInfo:
        if self._station is None:
            return SessionInfo(kind="REPLAY")
        kind = "SIM" if self._station.world is not None else "REAL"
        words = "" if self.recording is None else self.recording.words
        return SessionInfo(kind=kind, factor=self._frame_rate.factor, recording=words)

    @property
    def stack(self) -> "Stack | None":
        return self._stack

    def run_in_background(self, job: Callable[[], T], done: Callable[[T], None]) -> None:
        self._jobs.begin(job, done)

    def run_line(self, line: str) -> None:
        self._commands.run_line(line)

    @property
    def perform(self) -> Callable[[Operation[Outcome] | AppCommand], None]:
        """What does a typed operation; the key calls it directly."""
        return self._commands.perform

    @property
    def last(self) -> str:
        return self._commands.last

    def is_local(self, line: str) -> bool:
        return self._commands.is_local(line)

    @property
    def draft_items(self) -> tuple[Target, ...]:
        return self._commands.draft_items

    def complete(self, text: str) -> list[str]:
        return self._commands.complete(text)

    def recall(self, text: str, step: int) -> str:
        return self._commands.recall(text, step)

    def begin_teleop(self) -> bool:
        return self._commands.begin_teleop()

    def steer(self, speed_m_s: float, yaw_rate_rad_s: float) -> None:
        self._commands.steer(speed_m_s, yaw_rate_rad_s)

    def end_teleop(self) -> None:
        self._commands.end_teleop()

    def note(self, text: str) -> None:
        self.station.note(text)

    def choose(self, title: str, choices: list[str], done: Callable[[str], None]) -> None:
        from ground.app.screens.choice import ChoiceScreen  # seldom needed, so not at the start

        def take(choice: str | None) -> None:
            if choice:
                done(choice)
            self.redraw()

        self.push_screen(ChoiceScreen(title, choices), take)

    def open_replay(self, path: Path) -> None:
        """Show a recording; UserError when it cannot be played."""
        from ground.app.playback.player import Player  # recordings are not what one comes for

        self.player = Player(path, WallClock())
        self.switch_mode("replay")

    @property
    def defect(self) -> Exception | None:
        """What ended the app when that was none of the operator's doing."""
        return self._exception

    def _fatal_error(self) -> None:
        """Textual would draw a page of our local variables; whoever runs the app tells it."""
        self._close_messages_no_wait()

    def clear_selection(self) -> None:
        """From Python 3.12 on the first screen is composed before it is on Textual's stack."""
        with suppress(ScreenStackError):
            super().clear_selection()

    def get_line_filters(self) -> Sequence[LineFilter]:
        """Textual's own, and ours: robots, files and names may say anything."""
        return [*super().get_line_filters(), self._printable]

    def get_driver_class(self) -> type[Driver]:
        from ground.app.input.driver import with_robust_input  # not where nobody has a terminal

        return with_robust_input(super().get_driver_class())

    # The round.

    def sample(self) -> None:
        """Poll, and draw when it is time to."""
        if self._station is not None:
            self._station.poll()
            self._frame_rate.measure_time_factor(self._station)
        if self.player is not None:
            self.player.poll()
        self._look_after_recording()
        self._jobs.poll()
        if self._stack is not None and (news := self._stack.next_event()):
            self.station.note(news, Severity.ERROR)
        if self.base_screen is not None:
            self.base_screen.poll()
        if self._frame_rate.due(monotonic_ns()):
            self.redraw()

    def _look_after_recording(self) -> None:
        if self.recording is None or self._station is None:
            return
        is_receiving = self._station.seen(HEARTBEAT).age is Age.LIVE
        for words in self.recording.poll(is_receiving=is_receiving):
            loud = words.startswith("RECORDING")
            self._station.note(words, Severity.CRITICAL if loud else Severity.WARNING)

    def limit_frame_rate(self, terminal: Drawable) -> None:
        """Draw no more than this takes."""
        self._frame_rate.terminal = terminal

    def redraw(self) -> None:
        sheet = self.base_screen
        if sheet is not None:
            sheet.redraw()

    @property
    def base_screen(self) -> AppScreen | None:
        """The screen below whatever is open above it."""
        sheets = (screen for screen in reversed(self.screen_stack) if isinstance(screen, AppScreen))
        return next(sheets, None)

    def on_resize(self, event: events.Resize) -> None:
        """One that was smaller for a moment has lost what was on it, and its size is as before."""
        if self._settling is not None:
            self._settling.stop()
        self._settling = self.set_timer(SETTLED_S, self.refresh)

    def on_app_blur(self, event: events.AppBlur) -> None:
        self._frame_rate.focused = False

    def on_app_focus(self, event: events.AppFocus) -> None:
        self._frame_rate.focused = True

    # Keys.

    def key_layers(self) -> tuple[Layer, ...]:
        sheet = self.screen
        own = sheet.key_layers() if isinstance(sheet, AppScreen) else ()
        return (Layer.ALWAYS, *own)

    def keys_now(self) -> list[KeyBinding]:
        """What keys do on the screen below, for the help and the palette above it."""
        doable, sheet = self.doable(), self.base_screen
        layers = () if sheet is None else sheet.key_layers()
        keys = self._keymap_in_force.of(Layer.ALWAYS, *layers)
        return [key for key in keys if key.id in doable]

    def begin_line(self, text: str) -> None:
        """Let a command be typed on."""
        if self.base_screen is not None:
            self.base_screen.ask("", text, self.base_screen.interface.run_line)

    def doable(self) -> Mapping[str, Action]:
        """What can be done here, by id."""
        sheet = self.base_screen
        return {**self._robot_keys.actions(), **(sheet.actions() if sheet is not None else {})}

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:
        if action != "do":
            return super().check_action(action, parameters)
        (id,) = parameters
        known = self._keymap_in_force[str(id)]
        return known.layer in self.key_layers() and known.id in self.doable()

    def action_do(self, id: str) -> None:
        self.doable()[id]()
        self.redraw()
