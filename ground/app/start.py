"""Open the app over a connected link, and restore the terminal at the end.

While it is open, all output but that of the app goes to a log file.
"""

import asyncio
import os
import signal
import sys
import termios
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from io import BufferedWriter, FileIO, TextIOWrapper
from pathlib import Path
from threading import Lock, Timer
from time import time_ns
from typing import TYPE_CHECKING, Final

from ground.app.appearance import DUMB, AppOptions, appearance_of, has_colours, in_browser
from ground.app.input.keymap import TABLE, Keymap, key_hints, load
from ground.app.input.keymap import keymap_of as keymap_in
from ground.client.connection import Common
from ground.client.lease_holder import operator_name
from ground.recording.log_reader import files_of, robot_in
from ground.user.folders import PRIVATE_FILE, state_folder
from ground.user.settings import Settings, load_settings, set_setting, settings_file
from protocol.bus.bus import Bus
from protocol.bus.network import Network
from runtime.clock import WallClock, freeze_heap
from runtime.config import line_located
from runtime.errors import EXIT_SIGNAL

if TYPE_CHECKING:
    from textual.app import App

    from ground.app.app import GroundApp
    from ground.app.vehicle_app import VehicleApp
    from ground.launch.launcher import Stack
    from ground.launch.recording_session import RecordingSession
    from ground.station.station import Station
    from vehicle_check.networks import VehicleNetwork


OUTPUTS: Final = (1, 2)
MOST_BYTES: Final = 1_000_000


class TerminalText(TextIOWrapper):
    """A text stream to the terminal that is `busy` from a write until the flush after it.

    Textual writes from its own thread, and flushes when nothing else waits to be written.
    """

    def __init__(self, descriptor: int) -> None:
        super().__init__(BufferedWriter(FileIO(descriptor, "w")), encoding="utf-8")
        self.busy = False

    def write(self, text: str) -> int:
        """Write a text."""
        self.busy = True
        return super().write(text)

    def flush(self) -> None:
        """Flush, which blocks until the terminal has taken everything."""
        super().flush()
        self.busy = False


@contextmanager
def capture_output(log: Path) -> Iterator[TerminalText]:
    """Redirect standard output and error to the log, and yield the stream of the screen.

    Native libraries write to the file descriptors, so these are exchanged. Textual draws through
    `sys.__stderr__` and asks `sys.__stdout__` for the size of the terminal (a browser's driver
    writes there); both keep the terminal.
    """
    sys.stdout.flush()
    sys.stderr.flush()
    kept = {number: os.dup(number) for number in OUTPUTS}
    before = sys.__stdout__, sys.__stderr__
    sink = open_log(log)
    screens = [TerminalText(os.dup(kept[number])) for number in OUTPUTS]
    for number in OUTPUTS:
        os.dup2(sink, number)
    vars(sys).update(__stdout__=screens[0], __stderr__=screens[1])
    try:
        yield screens[1]
    finally:
        vars(sys).update(__stdout__=before[0], __stderr__=before[1])
        sys.stdout.flush()
        sys.stderr.flush()
        for screen in screens:
            screen.close()
        for number, saved in kept.items():
            os.dup2(saved, number)
            os.close(saved)
        os.close(sink)


def open_log(log: Path) -> int:
    """Open the log file; delete it first when it is too long.

    Open /dev/null when it cannot be written.
    """
    try:
        log.parent.mkdir(parents=True, exist_ok=True)
        if log.exists() and log.stat().st_size > MOST_BYTES:
            log.unlink()
        return os.open(log, os.O_WRONLY | os.O_CREAT | os.O_APPEND, PRIVATE_FILE)
    except OSError:
        return os.open(os.devnull, os.O_WRONLY)


SIGNALS: Final = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
CHECK_S: Final = 1.0
CLOSING_S: Final = 3.0
ENDING_S: Final = 1.0
SAVING: Final = Lock()
FREEZE_AFTER_S: Final = 3.0
"""By then the app has created its permanent objects. A full collection later takes 60 ms."""


def run(
    options: AppOptions,
    bus: Bus,
    common: Common,
    stack: "Stack | None" = None,
    recording: "RecordingSession | None" = None,
    *,
    lessons: bool = False,
) -> int:
    """Run the app until the operator leaves, and return 0. With `lessons`, the tutorial guides.

    Raise ConfigError for settings or keys that cannot be used. The app monitors the processes of
    its `stack`, and may restart them.
    """
    settings = load_settings()
    keymap, appearance = keymap_of(options, settings), appearance_of(options, settings)
    # Textual is imported only here, so that other verbs start fast.
    from ground.app.app import GroundApp
    from ground.app.commands.local_commands import LocalCommands
    from ground.app.commands.runner import CommandRunner
    from ground.console.history import History
    from ground.station.station import Station

    station = Station(bus, common.robot, WallClock(), name=operator_name(None), common=common)
    station.queue.hints = key_hints(keymap)
    commands = CommandRunner(lambda: station, common, History(state_folder() / "history"))
    app = GroundApp(station, commands, keymap, appearance, stack, recording=recording)
    app.is_first_start, app.remember_theme = is_first_start(state_folder()), remember_theme
    if lessons:
        app.begin_tutorial()
    commands.local = LocalCommands(app).do_command
    with capture_output(state_folder() / "ground.log") as terminal:
        app.limit_frame_rate(terminal)
        code = run_app(app, station)
    logs = [] if stack is None else stack.recordings()  # one for each world that was started
    logs = [log for log in logs if robot_in(log) == common.robot]
    newest = None if recording is None else recording.file
    print_summary(station.last_drives(), logs if newest is None else [*logs, newest])
    return code


def print_summary(drives: Mapping[str, str], recorded: Iterable[Path]) -> None:
    """Print how the last drive of each robot ended, and where the recordings are."""
    if in_browser(os.environ):
        return  # standard output belongs to the browser
    with suppress(OSError):  # the terminal may have gone
        for robot, words in drives.items():
            print(f"{robot}: {words}")
        for first in dict.fromkeys((files_of(one) or [one])[0] for one in recorded):
            print(f"recording: {first} (sidestep replay)")
        sys.stdout.flush()


def run_replay(
    options: AppOptions,
    path: Path,
    robot: str | None,
    at_s: float,
    progress: Callable[[float], None],
) -> int:
    """Run the app over a recording, without commands. Raise UserError when it cannot be played.

    `progress` receives the share of the file that was read, before the app opens.
    """
    settings = load_settings()
    keymap, appearance = keymap_of(options, settings), appearance_of(options, settings)
    from ground.app.app import GroundApp
    from ground.app.commands.local_commands import LocalCommands
    from ground.app.commands.runner import CommandRunner
    from ground.app.playback.player import Player
    from ground.console.history import History

    clock = WallClock()
    player = Player(path, clock, robot, progress)
    player.seek(at_s)
    common = Common(network=Network(), robot=player.bus.robot)
    history = History(state_folder() / "history")
    commands = CommandRunner(lambda: player.station, common, history)
    app = GroundApp(None, commands, keymap, appearance, player=player)
    app.remember_theme = remember_theme
    commands.local = LocalCommands(app).do_command
    with capture_output(state_folder() / "ground.log") as terminal:
        app.limit_frame_rate(terminal)
        return run_app(app)


def run_watch(options: AppOptions, network: "VehicleNetwork", system: int, folder: Path) -> int:
    """Show a MAVLink vehicle until the user leaves; close the network."""
    appearance = appearance_of(options, load_settings())
    from ground.app.vehicle_app import VehicleApp

    offset_ns = time_ns() - network.now_ns()
    try:
        app = VehicleApp(network, system, folder, offset_ns, appearance)
        with capture_output(state_folder() / "ground.log"):
            return run_app(app)
    finally:
        network.close()


def run_app(app: "GroundApp | VehicleApp", station: "Station | None" = None) -> int:
    """Run the app until the operator leaves or a signal ends it; raise a defect.

    What the station has begun then ends, such as a drive by hand, but never late.
    A signal handler that raises would only cancel Textual's tasks, and Textual would go on.
    """

    async def shown() -> int:
        loop = asyncio.get_running_loop()
        for number in SIGNALS:
            loop.add_signal_handler(number, exit_on_signal, app, number)
        if sys.__stdin__ is not None and sys.__stdin__.isatty():
            watch_terminal(loop, app, sys.__stdin__.fileno())
        loop.call_later(FREEZE_AFTER_S, freeze_heap)
        try:
            code = await app.run_async() or 0
        finally:
            if station is not None:
                await end(station)
        if app.defect is not None:
            raise app.defect
        return code

    return asyncio.run(shown())


async def end(station: "Station") -> None:
    """Let a station end what it has begun and leave its leases, but never late."""
    for ending, within_s in ((station.queue.over(), ENDING_S), (station.close(), CLOSING_S)):
        with suppress(TimeoutError):
            await asyncio.wait_for(ending, within_s)


def watch_terminal(loop: asyncio.AbstractEventLoop, app: "App[int]", terminal: int) -> None:
    """End the app when the terminal has disappeared without a signal."""
    try:
        termios.tcgetattr(terminal)
    except termios.error:
        exit_on_signal(app, signal.SIGHUP)
        return
    loop.call_later(CHECK_S, watch_terminal, loop, app, terminal)


def exit_on_signal(app: "App[int]", number: int) -> None:
    """End the app in order; by force when a lost terminal blocks that."""
    app.exit(EXIT_SIGNAL + number)
    late = Timer(CLOSING_S, os._exit, (EXIT_SIGNAL + number,))
    late.daemon = True
    late.start()


def keymap_of(options: AppOptions, settings: Settings) -> Keymap:
    """Load the keymap from the named file, else from the settings, else from the user's key file.

    Raises ConfigError, with the line, for keys that cannot be used.
    """
    if options.keys is None and settings.keys:
        file = settings_file()
        with line_located(file):
            return keymap_in({TABLE: settings.keys}, file=str(file))
    usual_place = state_folder() / "keys.toml"
    return load(options.keys or (usual_place if usual_place.exists() else None))


def is_first_start(folder: Path) -> bool:
    """Return True once for a state folder, and leave a mark there."""
    mark = folder / "hints-shown"
    if mark.exists():
        return False
    with suppress(OSError):
        folder.mkdir(parents=True, exist_ok=True)
        mark.touch()
    return True


def remember_theme(name: str) -> None:
    """Write the theme to the user's settings, unless this terminal has few colours."""
    if has_colours(os.environ):
        with SAVING:
            set_setting("theme", name)


def has_screen() -> bool:
    """Return whether the app can open: Textual reads standard input and draws on standard error.

    It cannot on a terminal that moves no cursor.
    """
    if os.environ.get("TERM") == DUMB and not in_browser(os.environ):
        return False
    streams = (sys.__stdin__, sys.__stdout__, sys.__stderr__)
    on_terminal = all(stream is not None and stream.isatty() for stream in streams)
    return on_terminal or in_browser(os.environ)
