"""The app by keys in the test's own time, on a station that shows what a test pins."""

import argparse
import asyncio
import json
import re
from collections.abc import AsyncIterator, Callable, Collection
from contextlib import asynccontextmanager, closing
from math import inf, radians
from pathlib import Path
from typing import Any, Final, TypeVar

import msgspec
import pytest
from msgspec.structs import replace
from textual.css.model import RuleSet
from textual.css.stylesheet import Stylesheet
from textual.pilot import Pilot

from checks.harness.loop import PlayedLoop
from checks.harness.messages import make
from checks.harness.until import PATIENCE_S
from ground.app.app import GroundApp
from ground.app.appearance import Appearance
from ground.app.input.keymap import Keymap
from ground.app.screens.drive import DriveScreen
from ground.app.widgets.lines import Lines
from ground.app.widgets.rows import words_of
from ground.client.connection import Common
from ground.client.floor import floor_in
from ground.client.leases import Leasing
from ground.client.parameter import Parameter
from ground.client.presence import PresentProcesses
from ground.client.telemetry import Age, AgedMessage
from ground.commands.command import OperatorCommand
from ground.console.completion import Assistance, Candidate, assist
from ground.launch.launcher import Stack
from ground.launch.scenario import Scenario
from ground.map.scene import MapScene, MapTarget, Outline, RobotMark
from ground.recording.log_reader import record_bytes
from ground.recording.mcap_file import McapFormat
from ground.robot import Robot
from ground.station.fleet import Attention, RosterEntry, by_attention
from ground.station.history.decision_history import Moment
from ground.station.history.event_log import EventLog
from ground.station.history.goal_progress import GoalProgress
from ground.station.link.loss import Loss
from ground.station.link.streams import StreamRow
from ground.station.robot.command_queue import (
    CommandQueue,
    Ended,
    JobResult,
    QueuedCommand,
    Witness,
)
from ground.station.robot.lease_state import LeaseView
from ground.station.robot.robot_stop import StopRecord
from ground.station.station import Station
from ground.station.world import WorldFacts
from protocol.bus.network import Network
from protocol.topics import (
    CYCLE,
    DECISION,
    DRIVE,
    HEARTBEAT,
    ODOMETRY,
    SONAR,
    STATUS,
    TRUTH,
    Role,
    Topic,
    sender_of,
)
from protocol.wire.codec import Encoder
from protocol.wire.enums import Branch, GoalState, LeaseAction, Vehicle
from protocol.wire.message import Message
from protocol.wire.messages import (
    AvoidanceDecision,
    CycleReport,
    GroundTruth,
    Heartbeat,
    McuStatus,
    NavigatorStatus,
    PlanarOdometry,
    SonarScan,
    WheelCommand,
)
from protocol.wire.reasons import Reason
from protocol.world import run_in
from runtime import files
from runtime.clock import ManualClock
from runtime.errors import RemoteError, UserError
from runtime.units import NS_PER_MS as MS
from runtime.units import NS_PER_S as S
from runtime.units import PERIOD_MS
from tests.support.ground.client import run_on
from tests.support.ground.station import WORLD_TEXT
from tests.support.played_bus import PlayedBus

NOTHING = AgedMessage(None, None, Age.GONE)
T = TypeVar("T")


class FakeStation(Station):
    """The station on a played bus, which a test does not poll; it shows what the test pins.

    `station.loss_now = x` pins what `station.loss()` returns, and so on for every name of Station.
    Requests run at once and are kept in `asked`.
    """

    live_now: bool
    world_now: WorldFacts | None
    loss_now: Loss | None
    progress_now: GoalProgress
    last_stop_now: StopRecord | None
    stopping_now: str
    restarted_now: str
    restart_cause_now: str
    robot_bus: PlayedBus | None = None
    """That of the robot, if it is not that of the station."""

    def __init__(self, clock: ManualClock | None = None) -> None:
        self.clock = clock or ManualClock(100 * S)
        self.bus = PlayedBus(self.clock)
        super().__init__(self.bus, "r1", self.clock)
        self.log = EventLog()
        self.queue = FakeCommandQueue(self)
        here = frozenset({("r1", "robot"), ("r1", "plant"), ("r1", "ground")})
        self._present = PresentProcesses(here)
        self.asked: list[str] = []
        self.polls = self.begun_again = self.stops = self.stops_of_all = 0
        self.robot_now, self.robots_now = "r1", ["r1"]
        self.scene_now = MapScene()
        self.ready_now, self.waiting_for_now = True, ""
        self.lease_now = LeaseView()
        self.parameters_now: tuple[Parameter, ...] | None = ()
        self.round_trip_ms_now, self.link_percent_now = 12.0, 100.0
        self.mission_items_now: tuple[MapTarget, ...] = ()
        self.restarts_of: dict[Role, int] = {}
        self.entries: list[RosterEntry] = []
        self.rows: list[StreamRow] = []
        self.decided: list[tuple[int, AvoidanceDecision]] = []

    def __getattribute__(self, name: str) -> Any:
        pinned = object.__getattribute__(self, "__dict__")
        if f"{name}_now" not in pinned:
            return super().__getattribute__(name)
        value = pinned[f"{name}_now"]
        return value if isinstance(vars(Station)[name], property) else lambda *_, **__: value

    def __setattr__(self, name: str, value: object) -> None:
        if name.endswith("_now") and name.removesuffix("_now") not in vars(Station):
            raise AttributeError(f"a station has no {name.removesuffix('_now')}")
        super().__setattr__(name, value)

    @property
    def _now_ns(self) -> int:
        """The time of a poll that is always just now."""
        return self.clock.now_ns()

    @_now_ns.setter
    def _now_ns(self, _: int) -> None:
        """Ignore the time of the last poll."""

    def poll(self) -> None:
        self.polls += 1

    def begin_again(self, ended: Collection[str] = ()) -> None:
        self.begun_again += 1

    def select(self, robot: str) -> None:
        """Show the telemetry of r1 under another name."""
        if not self._fleet.models:
            super().select(robot)
        self.robot_now = robot

    def roster(self, *, links: bool = False) -> list[RosterEntry]:
        """Return `entries`, and a quiet one for each other robot."""
        given = {entry.robot: entry for entry in self.entries}
        entries = [
            given.get(robot, RosterEntry(robot, False, Attention.NONE, "ready", NOTHING))
            for robot in self.robots()
        ]
        return by_attention(
            entry._replace(is_selected=entry.robot == self.robot) for entry in entries
        )

    def streams(self, robot: str = "") -> list[StreamRow]:
        """Return `rows` for the selected robot; the others have no streams."""
        return self.rows if robot in ("", self.robot) else []

    def status_of(self, robot: str) -> AgedMessage:
        return self.seen(STATUS)

    def restarts(self, role: Role) -> int:
        return self.restarts_of.get(role, 0)

    def limit(self, name: str) -> float | None:
        return {one.name: one.value for one in self.parameters or ()}.get(name)

    @property
    def parameters_words(self) -> str:
        return "41" if self.parameters is not None else "41 missing: requested 2 times, no answer"

    @property
    def worst_cycle(self) -> CycleReport | None:
        newest = self.telemetry.latest(CYCLE)
        return None if newest is None else newest[0]

    @property
    def silent_sonars(self) -> int:
        newest = self.telemetry.latest(SONAR)
        return 0 if newest is None else 0xFF & ~newest[0].valid

    def moment(self, time_ns: int | None = None) -> Moment | None:
        heard, now_ns = self.telemetry, self.now_ns
        decision = heard.live(DECISION, now_ns)
        if decision is None:
            return None
        status, cycle = heard.live(STATUS, now_ns), heard.live(CYCLE, now_ns)
        return Moment(now_ns, decision, None, status, cycle)

    def decisions(self, after_ns: int) -> list[tuple[int, AvoidanceDecision]]:
        return [pair for pair in self.decided if pair[0] > after_ns]

    def end_of(self, command: QueuedCommand, witness: Witness | None = None) -> Ended:
        """Perform a command on the robot that is shown, as the queue does."""

        async def carried_out() -> Ended:
            if witness is not None:
                await witness.before(robot)
            ended = await command.perform(robot)
            if witness is not None:
                witness.after(robot, ended)
            return ended

        common = Common(network=Network(), robot=self.robot)
        world = self.world
        floor = None if world is None else floor_in(world.text)
        robot = Robot(
            self.robot_bus or self.bus,
            common,
            clock=self.clock,
            leasing=Leasing.NEVER,
            follows=False,
            floor=lambda: floor,
        )
        try:
            with closing(PlayedLoop(self.clock)) as loop:
                return run_on(loop, carried_out())
        except (RemoteError, UserError) as error:
            return JobResult(False, str(error))

    def estop(self, robot: str = "") -> None:
        self.stops += 1

    def estop_all(self) -> None:
        self.stops_of_all += 1

    def reread(self) -> None:
        self.asked.append("reread")


class FakeCommandQueue(CommandQueue):
    """Performs commands of a fake station at once."""

    def __init__(self, station: FakeStation) -> None:
        super().__init__(station.clock, asyncio.create_task, station.note, "", lambda: None)
        self._station = station

    def refusal(self, *, moves: bool = True) -> str:
        return "" if self._station.ready or not moves else "no message from the robot for 2.0 s"

    def submit(
        self,
        words: str,
        command: QueuedCommand | LeaseAction,
        *,
        moves: bool = True,
        witness: Witness | None = None,
    ) -> bool:
        assert not isinstance(command, LeaseAction)
        self._station.asked.append(words)
        why = self.refusal(moves=moves)
        self._station.note(f"{words}: {why or self._station.end_of(command, witness).text}")
        return not why

    def lease(self, action: LeaseAction) -> None:
        is_held = action is not LeaseAction.RELEASE
        self._station.lease_now = LeaseView(held=is_held, ours=is_held)


class FakeCommandSink:
    """Records the commands that it was given."""

    def __init__(self) -> None:
        self.given: list[str] = []
        self.steered: list[tuple[float, float]] = []
        self.teleop = False
        self.last = ""
        self.draft_items: tuple[MapTarget, ...] = ()
        self.begun: list[bool] = []

    def begin_world(self, *, keeps_draft: bool) -> None:
        self.begun.append(keeps_draft)
        if not keeps_draft:
            self.draft_items = ()

    def run_line(self, line: str) -> None:
        if not line:
            return
        self.given.append(line)
        self.last = f"sidestep {line}"

    def perform(self, command: OperatorCommand, line: str = "") -> None:
        self.run_line(line or command.line)

    def assist(self, text: str) -> Assistance:
        return assist(text) if text else Assistance()

    def search(self, words: str) -> Assistance:
        found = (line for line in reversed(self.given) if words in line)
        return Assistance(tuple(Candidate(line, line) for line in found))

    def begin_teleop(self) -> bool:
        self.teleop = True
        return True

    def steer(self, speed_m_s: float, yaw_rate_rad_s: float) -> None:
        self.steered.append((speed_m_s, yaw_rate_rad_s))

    def end_teleop(self) -> None:
        self.teleop = False

    def recall(self, text: str, step: int) -> str:
        return self.given[-1] if self.given and step < 0 else ""


def driving(station: FakeStation, at_s: float = 0.0) -> FakeStation:
    """Fill a station with a robot on its way round an obstacle, `at_s` after the beginning."""
    now_ns = station.clock.now_ns() + round(at_s * S)
    for topic, message in drive_messages(now_ns).items():
        station.bus.say(topic, message, at_ns=now_ns)
    for ago_s in (8.9, 6.0, 4.0, 2.0, 0.0):
        then = status(now_ns - round(ago_s * S))
        then = replace(then, goal_started_ns=now_ns - 8_900 * MS)
        then = replace(then, goal_distance_m=6.42 + 0.265 * ago_s)
        station.progress.update(then)
    station.world_now = WorldFacts(
        "demo", (10.0, 8.0), (), (), (0.8, 1.0, 0.0), MapTarget(9.0, 7.0, 0.0), 0.12, "{}"
    )
    station.scene_now = scene()
    station.parameters_now = (
        parameter("d_obs_m", 0.3, 0.4, "sonars nearer than this make it avoid"),
        parameter("guard_stop_m", 0.1, 0.1, "nearer than this it does not drive ahead"),
        parameter("sonar_max_m", 3.0, 3.0, "farther than this there is no echo"),
    )
    station.rows = [
        StreamRow(topic, topic.rate_hz, 30 * MS, Age.LIVE, 178, 0, 0.0, 0, "")
        for topic in (HEARTBEAT, STATUS, ODOMETRY, SONAR, CYCLE)
    ]
    return station


def parameter(name: str, default: float, value: float, doc: str) -> Parameter:
    return Parameter(
        name=name, value=value, default=default, unit="m", minimum=0.0, maximum=5.0, doc=doc,
        saved=True,
    )  # fmt: skip


def drive_messages(now_ns: int) -> dict[Topic[Any], Message]:
    speeds = {"time_ns": now_ns, "speed_m_s": 0.31, "yaw_rate_rad_s": 0.1}
    return {
        HEARTBEAT: make(Heartbeat, autopilot=0, base_mode=0, system_status=4),
        STATUS: status(now_ns),
        ODOMETRY: make(
            PlanarOdometry, **speeds, x_m=4.12, y_m=2.84, heading_rad=radians(30),
            cov_xx_m2=1e-3, cov_xy_m2=2e-4, cov_yy_m2=2e-3, cov_hh_rad2=1e-3,
        ),
        DECISION: make(
            AvoidanceDecision, time_ns=now_ns, nearest_bearing_rad=radians(79),
            nearest_range_m=0.23, zone_m=0.30, goal_bearing_rad=radians(10),
            rotation_rad=radians(64), virtual_x_m=5.1, virtual_y_m=2.2, speed_m_s=0.25,
            yaw_rate_rad_s=-0.4, branch=Branch.PASS_RIGHT,
        ),
        TRUTH: make(
            GroundTruth, **speeds, seq=178, x_m=4.15, y_m=2.80, heading_rad=radians(31),
            clearance_m=0.1,
        ),
        CYCLE: make(
            CycleReport, time_ns=now_ns, tick=178, late_us=40, sense_age_us=9000, budget_us=2500,
            stage_us=(80, 12, 140, 9, 171),
        ),
        SONAR: make(
            SonarScan, time_ns=now_ns, seq=178, valid=0b1111_1101, echo=0b1111_1110,
            range_mm=(3000, 1800, 2030, 2120, 1370, 460, 230, 80),
        ),
    }  # fmt: skip


def status(
    now_ns: int, goal: int = GoalState.AVOIDING, vehicle: int = Vehicle.ACTIVE
) -> NavigatorStatus:
    return make(
        NavigatorStatus,
        time_ns=now_ns,
        goal_started_ns=now_ns - 8_900 * MS,
        goal_id=7,
        goal_x_m=9.0,
        goal_y_m=7.0,
        goal_distance_m=6.42,
        vehicle=vehicle,
        goal=goal,
    )


def scene() -> MapScene:
    box = ((5.0, 3.5), (6.2, 3.5), (6.2, 5.2), (5.0, 5.2))
    trail = tuple((0.8 + 0.11 * k, 1.0 + 0.061 * k) for k in range(31))
    return MapScene(
        size_m=(10.0, 8.0),
        obstacles=(Outline(((0, 0), (10, 0), (10, 8), (0, 8))), Outline(box)),
        trail=trail,
        robot=RobotMark(4.12, 2.84, radians(30), 0.12),
        true_robot=RobotMark(4.15, 2.80, radians(31), 0.12),
        covariance=(0.01, 0.002, 0.02),
        ranges_m=(inf, None, 2.03, 2.12, 1.37, 0.46, 0.23, 0.08),
        zone_m=0.3,
        goal=MapTarget(9.0, 7.0, 0.0),
        virtual_goal=(5.4, 2.6),
        hits=((3.33, 2.40),),
    )


def mcu_status() -> McuStatus:
    return McuStatus(
        time_ns=0,
        tick=40,
        command_us=6_019,
        busy_us=21_592,
        budget_us=50_000,
        ram_bytes=52_244,
        ram_size_bytes=56_856,
        skipped_bytes=699,
        emulated=1,
    )


STOP_ID = 5
REASONS = {
    Vehicle.EMERGENCY_STOP: (Reason.BY_OPERATOR, Reason.BY_EMERGENCY_STOP),
    Vehicle.FAILSAFE: (Reason.BUDGET, Reason.BUDGET),
    Vehicle.STANDBY: (Reason.NONE, Reason.BY_EMERGENCY_STOP),
    Vehicle.ACTIVE: (Reason.NONE, Reason.BUDGET),
}


def stopped(vehicle: Vehicle, station: FakeStation | None = None) -> FakeStation:
    """Fill a station with a robot that we stopped 12 s ago, or that has stopped itself."""
    station = station or driving(FakeStation())
    show(station, stopped_status(vehicle, station.clock.now_ns()))
    station.last_stop_now = StopRecord(STOP_ID, station.clock.now_ns() - 12 * S, 36 * MS)
    return station


def show(station: FakeStation, shown: NavigatorStatus) -> None:
    """Put a status of r1 on the air, with wheels that stand."""
    now_ns = station.clock.now_ns()
    odometry = drive_messages(now_ns)[ODOMETRY]
    assert isinstance(odometry, PlanarOdometry)
    station.bus.say(STATUS, shown)
    station.bus.say(ODOMETRY, replace(odometry, speed_m_s=0.0, yaw_rate_rad_s=0.0))
    station.entries = [*(one for one in station.entries if one.robot != "r1")]
    station.entries.append(entry("r1", shown))


def stopped_status(vehicle: Vehicle, now_ns: int) -> NavigatorStatus:
    """Return the status of a stopped robot, or of one that is armed or disarmed after a stop."""
    vehicle_reason, goal_reason = REASONS[vehicle]
    return replace(
        status(now_ns, GoalState.ABORTED, vehicle),
        vehicle_reason=vehicle_reason,
        goal_reason=goal_reason,
        stop_id=STOP_ID,
        goal_x_m=6.4,
        goal_y_m=6.4,
        goal_heading_rad=radians(45),
    )


def entry(robot: str, shown: NavigatorStatus, age: Age = Age.LIVE) -> RosterEntry:
    """Return a robot of the roster with this status."""
    return RosterEntry(robot, False, Attention.NONE, "", AgedMessage(shown, 0, age))


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


FOLDER: Final = Path(__file__).parents[2] / "docs" / "pictures" / "screens"
FONT: Final = re.compile(r"@font-face \{.*?\}\s*", re.DOTALL)
"""The pictures ask for a font from another host; readers have fonts of their systems."""
TERMINAL_ID: Final = re.compile(r"terminal-\d+-")
ACTUAL: Final = ".actual.svg"


def normalised(svg: str) -> str:
    """Remove the checksum by which Rich names its styles and clips, and the font."""
    lines = TERMINAL_ID.sub("terminal-", FONT.sub("", svg)).splitlines()
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
