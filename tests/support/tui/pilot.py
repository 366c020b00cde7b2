"""Run an app by keys in the test's own time, with worlds, a recording, and pictures."""

import argparse
import asyncio
import json
import re
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from math import inf
from pathlib import Path
from typing import Any, Final, TypeVar

import msgspec
import pytest
from textual.css.model import RuleSet
from textual.css.stylesheet import Stylesheet
from textual.pilot import Pilot

from checks.harness.messages import make
from ground.app.app import GroundApp
from ground.app.appearance import Appearance
from ground.app.input.keymap import Keymap
from ground.app.screens.drive import DriveScreen
from ground.app.widgets.lines import Lines
from ground.app.widgets.rows import words_of
from ground.launch.launcher import Stack
from ground.launch.scenario import Scenario
from ground.recording.log_reader import record_bytes
from ground.recording.mcap_file import McapFormat
from protocol.topics import DRIVE, ODOMETRY, Role, sender_of
from protocol.wire.codec import Encoder
from protocol.wire.messages import PlanarOdometry, WheelCommand
from protocol.world import run_in
from runtime import files
from runtime.clock import ManualClock
from runtime.units import NS_PER_MS as MS
from runtime.units import NS_PER_S as S
from runtime.units import PERIOD_MS
from tests.support.ground.station import WORLD_TEXT
from tests.support.tui.fakes import FakeCommandSink, FakeStation, drive_messages, driving
from tests.support.until import PATIENCE_S

T = TypeVar("T")


class Stage:
    """The app, its pilot, its station and its command sink."""

    def __init__(
        self, app: GroundApp, pilot: Pilot[int], station: FakeStation, commands: FakeCommandSink
    ):
        self.app, self.pilot, self.station, self.commands = app, pilot, station, commands

    @property
    def drive(self) -> DriveScreen:
        assert isinstance(self.app.screen, DriveScreen)
        return self.app.screen

    async def press(self, *keys: str) -> None:
        await self.pilot.press(*keys)
        await self.redraw()

    async def redraw(self) -> None:
        """Draw, and let Textual handle the consequences."""
        await self.pilot.pause()
        self.app.redraw()
        await self.pilot.pause()

    async def until(self, condition: Callable[[], object]) -> None:
        """Let Textual work until the condition holds."""
        async with asyncio.timeout(PATIENCE_S):
            while not condition():
                await self.pilot.pause(0.01)

    async def until_shown(self, id: str, text: str) -> None:
        """Draw until a panel of the screen has this text; a screen may still be opening."""
        async with asyncio.timeout(PATIENCE_S):
            while not self.app.screen.query(f"#{id}") or text not in self.words(id):
                await self.redraw()

    async def type(self, text: str) -> None:
        await self.pilot.press(*(NAMES.get(letter, letter) for letter in text))

    def words(self, id: str) -> str:
        """Return the text of a panel."""
        rows = self.app.screen.query_one(f"#{id}", Lines).rows
        return "\n".join(words_of(row) for row in rows)

    def log(self) -> str:
        return "\n".join(line.text for line in self.station.log)


NAMES = {" ": "space", ".": "full_stop", "-": "minus", ":": "colon"}


@asynccontextmanager
async def staged(
    size: tuple[int, int] = (80, 24),
    *,
    station: FakeStation | None = None,
    theme: str = "dark",
    ascii_only: bool = False,
    keymap: Keymap | None = None,
    messages: bool = False,
) -> AsyncIterator[Stage]:
    """Open the app, with a robot on its way unless a station is given.

    `messages` shows Textual's messages.
    """
    station = station or driving(FakeStation())
    commands = FakeCommandSink()
    app = GroundApp(
        station, commands, keymap, Appearance(theme=theme, ascii_only=ascii_only, hz=0.0)
    )
    async with app.run_test(size=size, notifications=messages) as pilot:
        stage = Stage(app, pilot, station, commands)
        await stage.redraw()
        yield stage


SOON_S: Final = 0.02
"""A timer that is due within this time is waited for, as Textual's own pilot does."""
ROUNDS: Final = 2
MAX_TIMERS: Final = 50
"""A timer that repeats quickly is not waited for any longer: for 1 s if it is due in `SOON_S`."""

parse_rules: Final = Stylesheet._parse_rules
parsed: Final[dict[object, list[RuleSet]]] = {}


def hasten(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let Textual's pilot wait for the event loop, and share style sheets between apps."""
    monkeypatch.setattr("textual.pilot.wait_for_idle", settled)
    monkeypatch.setattr("textual.app.wait_for_idle", settled)
    monkeypatch.setattr(Stylesheet, "_parse_rules", parsed_once)


async def settled(*_: float) -> None:
    """Return when no callback is ready and no timer is due soon.

    In place of `textual._wait.wait_for_idle`, which sleeps 20 ms, and again for up to 1 s while the
    process uses the processor. A busy machine changes nothing here: callbacks are awaited as long
    as there are any, and timers are counted.
    """
    loop: Any = asyncio.get_running_loop()
    quiet = timers = 0
    while quiet < ROUNDS:
        await asyncio.sleep(0)
        quiet = 0 if loop._ready else quiet + 1
        if quiet == ROUNDS and timers < MAX_TIMERS:
            waiting = [timer.when() for timer in loop._scheduled if not timer.cancelled()]
            wait_s = min(waiting, default=inf) - loop.time()
            if wait_s < SOON_S:
                await asyncio.sleep(max(0.0, wait_s))
                quiet, timers = 0, timers + 1


def parsed_once(sheet: Stylesheet, css: str, *where: Any, **how: Any) -> list[RuleSet]:
    """Return the rules of a style sheet, which is parsed again for other variables only."""
    key = (css, where, tuple(how.items()), tuple(sheet._variables.items()))
    if key not in parsed:
        parsed[key] = parse_rules(sheet, css, *where, **how)
    return parsed[key]


WORLD: dict[str, Any] = {
    "name": "box",
    "size_m": [6.0, 4.0],
    "start": {"x_m": 0.6, "y_m": 2.0, "heading_deg": 0.0},
    "goal": {"x_m": 5.4, "y_m": 2.0, "heading_deg": 0.0},
    "obstacles": [
        {"polygon_m": [[2.5, 1.6], [3.3, 1.6], [3.3, 2.4], [2.5, 2.4]]},
        {
            "circle_m": {"x": 4.5, "y": 3.0, "radius": 0.15},
            "path_m": [[4.5, 3.0], [4.5, 1.0]],
            "speed_m_s": 0.1,
        },
    ],
    "faults": [],
    "shortest_path_m": 5.0,
}
FAULTS = {
    "faults": [
        {"kind": "sonar_frozen", "targets": ["0", "1", "all"], "unit": "", "says": "repeats"},
        {"kind": "ticks_stopped", "targets": [""], "unit": "", "says": "no ticks"},
    ]
}


class FakeStack(Stack):
    """Starts no processes and records its calls."""

    def __init__(self) -> None:
        super().__init__(argparse.Namespace(), self.scenario_of("box"), "", ManualClock())
        self.begun: list[str] = []
        self.driven: list[str] = []
        self.done: list[tuple[str, str]] = []

    def scenario_of(self, world: str) -> Scenario:
        return Scenario(
            world=world, name=world, run=run_in(WORLD_TEXT), scenario_robots=(),
            navigator="vgm", side="left", seed=0, noise=None, speed="1", router=False, record=None,
            timeout_s=1.0,
        )  # fmt: skip

    def roles(self) -> list[str]:
        return ["robot r1", "plant"]

    def check(self) -> None:
        """Report no problems."""

    def restarted(self, scenario: Scenario, stopped: Callable[[], None] = lambda: None) -> None:
        stopped()
        self.scenario = scenario
        self.begun.append(scenario.name)

    def drive_to_goals(self) -> list[str]:
        self.driven.append(self.scenario.name)
        return []

    def scenario_in(self, world: str, faults: Any = ()) -> Scenario:
        return self.scenario_of(" ".join([world, *(str(fault["kind"]) for fault in faults)]))

    def inject_fault(self, role: str, what: str) -> str:
        self.done.append((role, what))
        return f"{what} {role}"


class SynchronousApp(GroundApp):
    """Runs background jobs at once."""

    def run_in_background(self, job: Callable[[], T], done: Callable[[T], None]) -> None:
        done(job())


@asynccontextmanager
async def on(screen: str, stack: Stack | None) -> AsyncIterator[Stage]:
    """Open a screen of an app that owns these processes."""
    station, commands = driving(FakeStation()), FakeCommandSink()
    app = SynchronousApp(station, commands, appearance=Appearance(hz=0.0), stack=stack)
    async with app.run_test(size=(100, 28)) as pilot:
        stage = Stage(app, pilot, station, commands)
        await stage.press(screen)
        yield stage


FOLDER: Final = Path(__file__).parents[2] / "tui" / "snapshots"
TERMINAL_ID: Final = re.compile(r"terminal-\d+-")
ACTUAL: Final = ".actual.svg"


def normalised(svg: str) -> str:
    """Remove the checksum by which Rich names its styles and clips."""
    lines = TERMINAL_ID.sub("terminal-", svg).splitlines()
    return "\n".join(line.rstrip() for line in lines) + "\n"


def compare(svg: str, name: str, *, update: bool, folder: Path = FOLDER) -> str:
    """Return "" when the screen is as committed, else what to do.

    The actual screen is saved beside the committed one.
    """
    actual, committed = normalised(svg), folder / f"{name}.svg"
    beside = folder / f"{name}{ACTUAL}"
    if beside.exists():  # the tree may be read-only
        beside.unlink()
    if committed.exists() and committed.read_text(encoding="utf-8") == actual:
        return ""
    if update:
        folder.mkdir(exist_ok=True)
        files.replace(committed, actual)
        return ""
    beside.write_text(actual, encoding="utf-8")
    what = "differs from" if committed.exists() else "has no"
    return f'{name} {what} {committed}; look at {beside}, take it with make refresh ARGS="screens"'


BEGAN_US = 1_700_000_000_000_000


PARAMETERS = {"radius_m": 0.12, "sonar_max_m": 3.0, "guard_stop_m": 0.04}


def recorded(folder: Path, seconds: float = 4.0, suffix: str = ".tlog") -> Path:
    """Write the file; each tick of 50 ms ends with a wheel command. An .mcap has parameters."""
    path = folder / f"20231114T221320Z-r1{suffix}"
    form = McapFormat("r1", {}, BEGAN_US)
    form.add_fact(
        "parameters", json.dumps([{"name": n, "value": v} for n, v in PARAMETERS.items()])
    )
    tlog = b""
    encoders = {role: Encoder(*sender_of(role, "r1")) for role in Role}
    for tick in range(round(seconds * 1000 / PERIOD_MS)):
        now_ns, time_us = 20 * S + tick * PERIOD_MS * MS, BEGAN_US + tick * PERIOD_MS * 1000
        messages = drive_messages(now_ns)
        odometry = messages[ODOMETRY]
        assert isinstance(odometry, PlanarOdometry)
        messages[ODOMETRY] = msgspec.structs.replace(odometry, x_m=0.02 * tick)
        messages[DRIVE] = make(WheelCommand, time_ns=now_ns, seq=tick, sense_seq=tick, ttl_ms=150)
        for topic, message in messages.items():
            frame = encoders[topic.publisher].encode(message)
            tlog += record_bytes(time_us, frame)
            form.add(topic.key("r1"), frame, time_us)
    path.write_bytes(tlog if suffix == ".tlog" else form.end())
    return path
