"""Define the app: screens, keys and a timer around a station.

Slow jobs run in daemon threads, so that neither the screen nor the exit waits for them.
"""

import os
import signal
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path
from time import monotonic_ns
from typing import TYPE_CHECKING, Any, ClassVar, Final, TypeVar

from textual import events
from textual.app import App, ScreenStackError
from textual.command import CommandPalette, Provider
from textual.driver import Driver
from textual.filter import LineFilter
from textual.timer import Timer
from textual.widgets import Input

from ground.app.app_interface import AppControl
from ground.app.appearance import TEXTUAL_THEMES, Appearance
from ground.app.chrome.key_bar import refusal_of
from ground.app.chrome.tabs import LOG, UnreadWarnings
from ground.app.chrome.tutorial import Tutorial
from ground.app.commands.command_sink import CommandSink
from ground.app.commands.robot_keys import RobotKeys
from ground.app.frame_rate import Drawable, FrameRate
from ground.app.input.key_queue import KeyQueue
from ground.app.input.keymap import (
    PROMPTS,
    KeyBinding,
    Keymap,
    Layer,
    bindings_of,
    names_of,
    shown,
)
from ground.app.panels.status import SIMULATION, SessionInfo
from ground.app.playback.player import RecordingReader
from ground.app.screens import SCREENS
from ground.app.screens.app_screen import Action, AppScreen
from ground.app.stops.alerts import Alerts
from ground.app.stops.band import Band, BandKeys, is_in_emergency_stop, stop_band
from ground.app.widgets.lines import Printable, cleaned
from ground.client.robot_link import in_own_thread
from ground.client.telemetry import Age
from ground.client.time_factor import TimeFactor
from ground.station.station import Station
from protocol.topics import HEARTBEAT, TRUTH, Role
from protocol.wire.enums import Severity
from runtime.errors import LocalError, RemoteError, UserError

if TYPE_CHECKING:
    from ground.app.playback.player import Player
    from ground.app.screens.choice import Choice
    from ground.launch.launcher import Stack
    from ground.launch.recording_session import RecordingSession


T = TypeVar("T")
POLL_HZ: Final = 20.0
SETTLED_S: Final = 0.2
"""The whole screen is painted again this long after the last change of the terminal's size."""


def palette() -> "type[Provider]":
    """Return the command palette's provider, imported when the palette is first opened."""
    from ground.app.commands.palette import CommandPalette

    return CommandPalette


def screen_of(name: str, app: AppControl) -> AppScreen:
    """Return a new screen by its name; its module is imported when it is first shown."""
    match name:
        case "drive":
            from ground.app.screens.drive import DriveScreen

            return DriveScreen(app)
        case "plots":
            from ground.app.screens.plots import PlotsScreen

            return PlotsScreen(app)
        case "params":
            from ground.app.screens.params import ParamsScreen

            return ParamsScreen(app)
        case "log":
            from ground.app.screens.log import LogScreen

            return LogScreen(app)
        case "links":
            from ground.app.screens.links import LinksScreen

            return LinksScreen(app)
        case "worlds":
            from ground.app.screens.worlds import WorldsScreen

            return WorldsScreen(app)
        case "faults":
            from ground.app.screens.faults import FaultsScreen

            return FaultsScreen(app)
        case "replay":
            from ground.app.screens.replay import ReplayScreen

            return ReplayScreen(app)
    raise ValueError(f"no screen: {name}")


def notification(text: str, *, in_tmux: bool) -> str:
    """Return OSC 9, which terminals show on the desktop; tmux passes it on in a wrapper."""
    sequence = f"\x1b]9;{cleaned(text)}\x07"
    return f"\x1bPtmux;\x1b{sequence}\x1b\\" if in_tmux else sequence


class GroundApp(App[int]):
    """Samples a station, draws what has changed, and passes on commands."""

    CSS_PATH = Path(__file__).with_name("ground.tcss")
    TITLE = "sidestep"
    DEFAULT_MODE = "drive"
    AUTO_FOCUS = ""
    is_first_start = False
    _tutorial: Tutorial | None = None
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
        """Create the app; without a `station`, every screen shows that of the player."""
        # With NO_COLOR, Textual would remove the colours of its default theme at this moment,
        # before ours is set. With a terminal's own colours, that leaves black on black.
        super().__init__(ansi_color=True if os.environ.get("NO_COLOR") else None)
        self.player, self.recording = player, recording
        self.appearance = appearance or Appearance()
        self._station, self.commands, self.stack = station, commands, stack
        self._keymap_in_force = keymap or Keymap()
        self._bindings = bindings_of(self._keymap_in_force)
        self._typed = KeyQueue(self, self._check_bindings)
        self.ascii_only = self.appearance.ascii_only
        self.reader = RecordingReader(self.run_in_background)
        self._frame_rate = FrameRate(self.appearance.hz)
        self._time_factor = TimeFactor(None if stack is None else stack.scenario.pace)
        self._settling: Timer | None = None
        self._printable = Printable()
        self._unread = UnreadWarnings()
        self.palette_uses: Counter[str] = Counter()
        self._robot_keys = RobotKeys(self)
        self._alerts = Alerts(self, self.appearance)
        for theme in TEXTUAL_THEMES:
            self.register_theme(theme)
        self.theme = self.appearance.theme
        self.remember_theme: Callable[[str], None] = lambda _: None
        for name in SCREENS:
            self.add_mode(name, partial(screen_of, name, self))
        self.set_class(self.ascii_only, "-ascii")

    def on_mount(self) -> None:
        """Show the replay when there is no robot, and start the timer."""
        if self._station is None:
            self.switch_mode("replay")
        for line in self.appearance.startup:
            self.call_later(self.commands.run_line, line)
        if self.appearance.hz:
            self.set_interval(1.0 / POLL_HZ, self.sample)

    # Implementation of AppControl, for the screens, keys and commands.

    @property
    def station(self) -> Station:
        """The station that is shown: that of the robot, else that of the recording."""
        if self._station is not None:
            return self._station
        assert self.player is not None, "needs a station or a recording"
        return self.player.station

    @property
    def session_info(self) -> SessionInfo:
        """The kind of session (simulation, real robot or replay) and its recording."""
        if self._station is None:
            return SessionInfo(kind="REPLAY")
        words = "" if self.recording is None else self.recording.words
        if self._station.world is None:
            return SessionInfo(self._kind_without_world(self._station), words)
        factor, now_ns = self._time_factor, self._station.now_ns
        return SessionInfo(factor.words(now_ns), words, factor.hint(now_ns))

    def begin_tutorial(self) -> None:
        """Show the first step of the tutorial."""
        self._tutorial = Tutorial(self.key_shown)

    @property
    def lesson(self) -> str:
        """The present step of the tutorial; empty without one."""
        return "" if self._tutorial is None else self._tutorial.words

    @property
    def unread_warnings(self) -> int:
        """The number of warnings and errors since the log screen was last shown."""
        self._unread.look(self.station.log, reading=self.current_mode == LOG)
        return self._unread.count

    def stop_band(self, width: int, height: int) -> Band:
        """Return the band about robots that have stopped, in plain words and with the next keys."""
        station = self.station
        since_ns = self._alerts.watch.since_ns(station.robot)
        return stop_band(station, since_ns, self._band_keys(), width, height)

    def _band_keys(self) -> BandKeys:
        """Return the keys of the band, and the way to where they are active."""
        if any(key.id == "arm" for key in self.keys_now()):
            return BandKeys(self.key_shown)
        on_drive = self.current_mode == self.DEFAULT_MODE
        where = self.key_shown("leave-line") if on_drive else f"{self.key_shown('screen-1')} Drive"
        return BandKeys(self.key_shown, where)

    def _kind_without_world(self, station: Station) -> str:
        """Return SIM with a plant, REAL without one; empty while the robot is not known."""
        if self.stack is not None or station.present.has(station.robot, Role.PLANT):
            return SIMULATION
        return SessionInfo().kind if station.ready else ""

    def run_in_background(self, job: Callable[[], T], done: Callable[[T], None]) -> None:
        """Run a slow job in a thread; `done` gets its result in this thread.

        Expected errors go to the log instead. The exit does not wait for the thread.
        """

        async def work() -> None:
            try:
                result = await in_own_thread(job, "job of the app")
            except (LocalError, RemoteError, OSError) as error:
                self.note(str(error))
            else:
                self.call_later(take, result)

        def take(result: T) -> None:
            if self.is_running:  # its screens are there
                done(result)

        self.run_worker(work(), exit_on_error=False)

    def note(self, text: str) -> None:
        """Add a line to the log."""
        self.station.note(text)

    def choose(
        self, title: str, choices: "Sequence[str | Choice]", done: Callable[[str], None]
    ) -> None:
        """Let the operator choose one of a few; `done` gets the choice."""
        from ground.app.screens.choice import ChoiceScreen  # rarely needed, so imported late

        def take(choice: str | None) -> None:
            if choice:
                done(choice)
            self.redraw()

        held_back = partial(is_in_emergency_stop, self.station)
        self.push_screen(ChoiceScreen(title, choices, held_back), take)

    def open_replay(self, path: Path) -> None:
        """Read a recording in the background, and show it. Raise UserError if there is none."""
        self.reader.begin(path, self._show_replay)
        self.switch_mode("replay")

    def _show_replay(self, player: "Player") -> None:
        self.player = player
        self.redraw()

    def suspend_to_shell(self) -> None:
        """Restore the terminal, and stop with the whole job until the shell continues it.

        The driver handles the signal.
        """
        if self._driver is not None and self._driver.can_suspend:
            os.kill(os.getpid(), signal.SIGTSTP)

    def notify_desktop(self, text: str) -> None:
        """Ask the terminal to show a notification on its desktop, also through ssh and tmux."""
        if self._driver is not None:
            self._driver.write(notification(text, in_tmux="TMUX" in os.environ))
            self._driver.flush()

    def use_mouse(self, *, is_used: bool) -> str:
        """Take the mouse, or leave it to the terminal, which selects text by it; say so."""
        driver: Any = self._driver
        name = "_enable_mouse_support" if is_used else "_disable_mouse_support"
        switch = getattr(driver, name, None)
        if switch is None:
            raise UserError("this screen has no mouse")
        switch()
        driver.flush()
        if is_used:
            return "the mouse works on the map and on lists"
        return "the mouse selects text of the terminal; :mouse on takes it back"

    def choose_theme(self, name: str) -> None:
        """Show a theme, and remember it for the next start."""
        self.theme = name
        self.run_in_background(lambda: self.remember_theme(self.theme), lambda _: None)

    @property
    def defect(self) -> Exception | None:
        """The unexpected exception that ended the app, if any."""
        return self._exception

    def _fatal_error(self) -> None:
        """End without Textual's page of local variables; the caller reports `defect`."""
        self._close_messages_no_wait()

    def clear_selection(self) -> None:
        """Clear the selection.

        From Python 3.12 on, Textual calls this before the first screen is on its stack.
        """
        with suppress(ScreenStackError):
            super().clear_selection()

    def get_line_filters(self) -> Sequence[LineFilter]:
        """Return Textual's filters and ours, because received names may hold control characters."""
        return [*super().get_line_filters(), self._printable]

    def get_driver_class(self) -> type[Driver]:
        """Return a driver whose input cannot be stopped by malformed sequences."""
        from ground.app.input.driver import with_robust_input  # needs a terminal

        return with_robust_input(super().get_driver_class())

    # The poll timer.

    def sample(self) -> None:
        """Poll all sources, and redraw when a frame is due."""
        if self._station is not None:
            self._station.poll()
            self._measure_time_factor(self._station)
        if self.player is not None:
            self.player.poll()
        self._alerts.poll()
        self._poll_recording()
        if self.stack is not None and (news := self.stack.next_event()):
            self.station.note(news, Severity.ERROR)
        if self.base_screen is not None:
            self.base_screen.poll()
        if self._frame_rate.due(monotonic_ns()):
            self.redraw()

    def _measure_time_factor(self, station: Station) -> None:
        """Compare the stamps of the plant with our clock."""
        truth = station.telemetry.latest(TRUTH)
        if truth is not None:
            self._time_factor.take(truth[0].time_ns, truth[1])
            station.set_pace(self._time_factor.pace(station.now_ns))

    def _poll_recording(self) -> None:
        """Log what the recorder reports."""
        if self.recording is None or self._station is None:
            return
        is_receiving = self._station.seen(HEARTBEAT).age is Age.LIVE
        for words in self.recording.poll(is_receiving=is_receiving):
            loud = words.startswith("RECORDING")
            self._station.note(words, Severity.CRITICAL if loud else Severity.WARNING)

    def limit_frame_rate(self, terminal: Drawable) -> None:
        """Skip frames while this terminal has not taken the last one."""
        self._frame_rate.terminal = terminal

    def redraw(self) -> None:
        """Redraw the base screen."""
        if self._tutorial is not None:
            self._tutorial.poll(self.station, len(self.commands.draft_items))
        sheet = self.base_screen
        if sheet is not None:
            sheet.redraw()

    @property
    def base_screen(self) -> AppScreen | None:
        """The screen below any dialogs."""
        sheets = (screen for screen in reversed(self.screen_stack) if isinstance(screen, AppScreen))
        return next(sheets, None)

    def on_resize(self, event: events.Resize) -> None:
        """Repaint everything when the size has settled.

        A terminal that was smaller for a moment has lost what it showed.
        """
        if self._settling is not None:
            self._settling.stop()
        self._settling = self.set_timer(SETTLED_S, self.refresh)

    def on_app_blur(self, event: events.AppBlur) -> None:
        """Lower the frame rate while the terminal has no focus."""
        self._frame_rate.focused = False

    def on_app_focus(self, event: events.AppFocus) -> None:
        """Restore the frame rate."""
        self._frame_rate.focused = True

    # Keys.

    async def on_event(self, event: events.Event) -> None:
        """Handle keys and pastes in order; a stop key does not wait until a screen is open."""
        if not isinstance(event, events.Key | events.Paste) or event.is_forwarded:
            await super().on_event(event)
            return
        self.app_focus = True
        await self._typed.take(event, at_once=isinstance(event, events.Key) and self._stops(event))

    def _stops(self, event: events.Key) -> bool:
        """Return whether a key is a stop on this screen, independent of the keys before it."""
        keymap = self._keymap_in_force
        ids: tuple[str, ...] = ("estop",)
        if self._typed.is_empty and Layer.STOP in self.key_layers():
            ids = (*ids, "estop-here", "estop-all")
        return any(event.key in names_of(keymap[id].keys) for id in ids)

    def key_layers(self) -> tuple[Layer, ...]:
        """Return the layers of keys that are active now."""
        sheet = self.screen
        if isinstance(sheet, AppScreen):
            return (Layer.ALWAYS, *sheet.key_layers())
        typing = isinstance(sheet.focused, Input) or isinstance(sheet, CommandPalette)
        return (Layer.ALWAYS,) if typing else (Layer.ALWAYS, Layer.STOP)

    def keys_now(self) -> list[KeyBinding]:
        """Return the keys of the base screen, for the help and the palette above it."""
        doable, sheet = self.doable(), self.base_screen
        layers = () if sheet is None else sheet.key_layers()
        keys = self._keymap_in_force.of(Layer.ALWAYS, *layers)
        return [key for key in keys if key.id in doable]

    def key_shown(self, id: str) -> str:
        """Return the first key of an action as it is shown; without one, its command."""
        keys = self._keymap_in_force[id].keys
        return shown(keys[:1]) if keys else f":{id}"

    def begin_line(self, text: str) -> None:
        """Let the operator continue typing a command."""
        if self.base_screen is not None:
            self.base_screen.ask("", text, self.base_screen.interface.commands.run_line)

    def doable(self) -> Mapping[str, Action]:
        """Return the actions that are possible now, by id.

        Before a screen has its widgets, only actions without widgets are possible.
        """
        sheet = self.base_screen
        own = sheet.actions() if sheet is not None and sheet.is_mounted else {}
        return {**self._robot_keys.actions(), **own}

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:
        """Return whether the key of an action is active now."""
        if action != "do":
            return super().check_action(action, parameters)
        (id,) = parameters
        known = self._keymap_in_force[str(id)]
        return known.layer in self.key_layers() and known.id in self.doable()

    def action_select_robot(self, robot: str) -> None:
        """Select a robot of the roster, and redraw."""
        self.station.select(robot)
        self.redraw()

    async def action_clicked(self, action: str) -> None:
        """Run the action of a click; in an emergency stop, none that may move the robot."""
        moving = {f"do('{key.id}')" for key in self._keymap_in_force.keys if key.may_move}
        if action not in moving or not self._is_held_back():
            await self.run_action(action)

    def run_chosen(self, id: str) -> None:
        """Run an action chosen from a list; in an emergency stop, none that may move the robot."""
        if not (self._keymap_in_force[id].may_move and self._is_held_back()):
            self.action_do(id)

    def _is_held_back(self) -> bool:
        """Return whether an emergency stop holds the robot, and say so."""
        held = is_in_emergency_stop(self.station)
        if held:
            self.note("in an emergency stop the robot is commanded by keys only")
        return held

    def action_do(self, id: str) -> None:
        """Run the action with this id, and redraw; no prompt for what would be refused."""
        refusal = refusal_of(self._keymap_in_force[id], self.station) if id in PROMPTS else ""
        if refusal:
            self.station.note(f"refused: {id}: {refusal}", Severity.WARNING)
        else:
            self.doable()[id]()
        self.redraw()
