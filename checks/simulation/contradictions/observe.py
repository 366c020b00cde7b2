"""The observer of contradictions: what programs say, compared with what was, seed by seed.

Each seed draws two persons with an app, terminals and a notebook, `up` and MAVLink stations, that
command one robot for 24 simulated seconds. Every outcome, answer, acknowledgement, exit code,
lease, band, status line, log text and recording summary is compared with the truth. A word that is
not so is printed with the seed, what was said, what was so, and the command that repeats it. The
options are those of `bench simulate`.

With `--beside` the programs are processes beside a real `up`, for a minute. The observer then has a
session of its own on the bus, from which it learns the truth: status, lease, mission and the
plant's pose. What the programs print is judged by the rules of the simulation. Which program has
asked for a goal is known from its place.
"""

import argparse
import asyncio
import json
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from functools import partial
from math import degrees
from pathlib import Path
from random import Random
from tempfile import TemporaryDirectory
from typing import Any, Final

from checks.harness.figures import BenchmarkReport, figure
from checks.harness.mavlink_client import MavlinkClient, UdpLine
from checks.harness.processes import free_port
from checks.harness.until import until
from checks.simulation import campaign
from checks.simulation.campaign import Campaign
from checks.simulation.contradictions.claims import contradictions
from checks.simulation.contradictions.persons import (
    CELLS,
    DEFECTS,
    NOTEBOOK,
    SHELL,
    TERMINALS,
    UP,
    draw,
    draw_persons,
    observe,
)
from checks.simulation.contradictions.persons import SENT as SENT_BY_STATIONS
from checks.simulation.contradictions.programs import Ack, Arguments, Cells
from checks.simulation.contradictions.truth import (
    Deed,
    EndedCommand,
    Journal,
    RequestTruth,
    RobotRow,
    ShownText,
    Truth,
)
from checks.simulation.hosts.mavlink import CLIENTS, command, reposition
from checks.simulation.invariants.limits import InvariantViolation
from gateways.mavlink.mavlink_dialect import mavlink
from ground.client.connection import common
from ground.client.outcomes import Accepted, GoalEnded, Refused
from ground.robot import connect
from ground.user.runs import read_runs
from protocol.bus.bus import open_bus
from protocol.topics import LEASE, MISSION, STATUS, TRUTH, Role
from protocol.wire.codec import decode
from protocol.wire.enums import Command, Mode
from protocol.wire.messages import (
    CommandRequest,
    GoalRequest,
    GroundTruth,
    LeaseStatus,
    MissionStatus,
    NavigatorStatus,
)
from protocol.wire.reasons import REASON_TEXTS
from runtime.units import NS_PER_MS, NS_PER_S

WORLD: Final = """
name = "plain"
size_m = [60.0, 60.0]
start = { x_m = 30.0, y_m = 30.0, heading_deg = 0.0 }
goal = { x_m = 37.3, y_m = 30.4, position_tolerance_m = 0.1, heading_tolerance_deg = 180.0 }
"""
GOAL: Final = (37.3, 30.4)
ENDS_S: Final = 20.0
JSON: Final = "--json"
LAG_NS: Final = 1_200 * NS_PER_MS
BEGIN_S, LAST_S = 2.0, 12.0
"""The first deed is so long after the lease is taken, the last one so long before the end."""

STATION: Final = next(iter(CLIENTS))


class WallTime:
    """The time of a run on the clock of this computer."""

    def __init__(self) -> None:
        self._began_ns = time.monotonic_ns()

    @property
    def now_ns(self) -> int:
        """The time since its begin."""
        return time.monotonic_ns() - self._began_ns


class TruthOfBus(Truth):
    """The truth as it passes on the bus; requests are known by what they have changed."""

    def __init__(self, clock: Any, journal: Journal, op_lost_ms: float) -> None:
        super().__init__(clock)
        self.lag_ns = LAG_NS
        self._journal = journal
        self._op_lost_ms = op_lost_ms
        self._pose: GroundTruth | None = None
        self._lease: LeaseStatus | None = None
        self._mission: MissionStatus | None = None
        self._lock = threading.Lock()

    def take(self, _key: str, frame: bytes, _at_ns: int) -> None:
        """Take a frame of the bus."""
        message = decode(frame).message
        with self._lock:
            match message:
                case GroundTruth():
                    self._pose = message
                case LeaseStatus():
                    self._lease = message
                case MissionStatus():
                    self._mission = message
                case NavigatorStatus():
                    self._take_status(message)

    def _take_status(self, status: NavigatorStatus) -> None:
        before, pose, lease, mission = self.rows[-1:], self._pose, self._lease, self._mission
        row = RobotRow(
            self.now_ns,
            status.vehicle,
            status.vehicle_reason,
            status.mode,
            status.goal,
            status.goal_reason,
            status.goal_id,
            status.stop_id,
            0 if mission is None else mission.state,
            0 if mission is None else mission.reason,
            0.0 if pose is None else pose.x_m,
            0.0 if pose is None else pose.y_m,
            0.0 if pose is None else pose.speed_m_s,
            lease.holder if lease is not None and lease.held else "",
            lease.name if lease is not None and lease.held else "",
            self._op_lost_ms,
        )
        self.shown(status)
        self.rows.append(row)
        # The robot may have its first goal before the first status arrives here.
        self._infer(before[0] if before else row._replace(goal_id=0), row, status)
        for deed in self._journal.deeds:
            self.heard_ns[deed.program].append(row.ns)

    def _infer(self, before: RobotRow, row: RobotRow, status: NavigatorStatus) -> None:
        """Note the request that has changed the goal or begun a drive by hand."""
        request: Any = None
        if row.goal_id != before.goal_id:
            place = round(status.goal_x_m * 1000), round(status.goal_y_m * 1000)
            request = goal_at(*place, row.goal_id)
            program = self._program(lambda deed: place_in(deed) == place)
        elif row.mode == Mode.MANUAL != before.mode:
            request = CommandRequest(
                request_id=0, param1=1.0, param2=float(Mode.MANUAL), command=Command.DO_SET_MODE
            )
            program = self._program(lambda deed: deed.verb == "drive")
        if request is not None:
            at = len(self.rows) - 1
            self.answered.append(RequestTruth(row.ns, program, "", request, True, 0, before, at))

    def _program(self, condition: Callable[[Deed], bool]) -> str:
        found = (deed for deed in reversed(self._journal.deeds) if condition(deed))
        return next((deed.program for deed in found), "")

    def person_of(self, operator: str) -> str:
        """Return the person of an operator on the bus."""
        return operator.partition("/")[0]

    def is_name(self, _program: str, _name: str) -> bool:
        """Believe the names that are shown: they contain a terminal of this computer."""
        return True


def goal_at(x_mm: int, y_mm: int, number: int) -> GoalRequest:
    """Return the request for a goal."""
    return GoalRequest(
        request_id=number,
        x_mm=x_mm,
        y_mm=y_mm,
        heading_urad=0,
        position_tolerance_mm=50,
        heading_tolerance_urad=0,
        heading_free=1,
        mode=Mode.GUIDED,
    )


def place_in(deed: Deed) -> tuple[int, int] | None:
    """Return the place of a deed that drives to one, in mm."""
    if deed.verb not in ("goto", "limited", "up", "drive") or len(deed.arguments) < 2:
        return None
    x_m, y_m = (float(one) for one in deed.arguments[:2])
    return round(x_m * 1000), round(y_m * 1000)


class PersonsTerminal:
    """A terminal of a person: each command is a process of `sidestep`."""

    def __init__(self, name: str, journal: Journal, environment: Mapping[str, str]) -> None:
        self._name, self._journal = name, journal
        self._environment = {**environment, "SIDESTEP_PERSON": name.partition("-")[0]}
        self._running: list[tuple[Deed, subprocess.Popen[str]]] = []
        self._count = 0

    def do(self, verb: str, arguments: Arguments) -> None:
        """Run a command."""
        self._running = [one for one in self._running if one[1].poll() is None]
        if verb == "cancel":
            for deed, process in self._running[-1:]:
                self._journal.cancel(deed)
                process.send_signal(signal.SIGINT)
            return
        self._count += 1
        deed = self._journal.begin(f"{self._name}.{self._count}", verb, arguments)
        typed = WORDS[verb](*arguments)
        words = [sys.executable, "-m", "sidestep", *typed, *(() if JSON in typed else (JSON,))]
        process = subprocess.Popen(
            words,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            stdin=subprocess.DEVNULL,
            text=True,
            env=self._environment,
        )
        self._running.append((deed, process))
        threading.Thread(target=self._read, args=(deed, process), daemon=True).start()

    def _read(self, deed: Deed, process: "subprocess.Popen[str]") -> None:
        out, told = process.communicate()
        for line in told.splitlines():
            self._journal.say(deed.program, ShownText("note", line), deed)
        row: dict[str, Any] = {}
        with suppress(ValueError):
            row = json.loads(out)
        outcome = outcome_in(row)
        if outcome is not None:
            self._journal.say(deed.program, outcome, deed)
        error = "" if outcome is not None else told.strip()
        self._journal.end(deed, EndedCommand(process.returncode, outcome, error))

    def close(self) -> None:
        """End all commands."""
        for _, process in self._running:
            if process.poll() is None:
                process.kill()


def outcome_in(row: Mapping[str, Any]) -> Any:
    """Return the outcome in a row of JSON; None if it is another one."""
    if "outcome" in row:
        return GoalEnded(row["outcome"], row["reason"], row.get("distance_m"), row["wall_s"])
    if row.get("reason_code") == 0:
        noted = (code for code, text in REASON_TEXTS.items() if text == row.get("note"))
        return Accepted(0, note=next(noted, 0))
    return Refused(int(row["reason_code"]), 0) if row.get("reason_code") else None


def seconds(value: float) -> tuple[str, ...]:
    """Return the option of a time limit, if there is one."""
    return ("--timeout", f"{value:g}") if value else ()


WORDS: Final[dict[str, Callable[..., tuple[str, ...]]]] = {
    "goto": lambda x_m, y_m, limit_s=0.0: ("goto", f"{x_m}", f"{y_m}", *seconds(limit_s)),
    "drive": lambda speed, turn, for_s: (
        *("teleop", "--for", f"{for_s:g}", JSON),
        *("--", f"{speed:g}", f"{degrees(turn):.3f}"),
    ),
    **{verb: partial(lambda word: (word,), verb) for verb in ("arm", "disarm", "hold", "resume")},
    **{verb: partial(lambda word: (word,), verb) for verb in ("abort", "estop")},
    "clear": lambda: ("clear-estop",),
    "take": lambda: ("lease", "take"),
    "seize": lambda: ("lease", "seize"),
    "release": lambda: ("lease", "release"),
    "lease": lambda: ("lease", "show"),
}


class RealNotebook:
    """A program with the Python API, in a thread with an event loop of its own."""

    def __init__(self, name: str, journal: Journal, endpoint: str) -> None:
        self._endpoint, self._cells = endpoint, Cells(name, journal)
        self._loop = asyncio.new_event_loop()
        self._leaving = asyncio.Event()
        self._robot: Any = None
        self._thread = threading.Thread(
            target=self._loop.run_until_complete, args=(self._program(),), daemon=True
        )
        self._thread.start()

    async def _program(self) -> None:
        async with connect(self._endpoint) as robot:
            self._robot = robot
            await self._leaving.wait()

    def do(self, verb: str, arguments: Arguments) -> None:
        """Run a cell."""
        if self._robot is not None:
            self._loop.call_soon_threadsafe(self._cells.begin, self._robot, verb, arguments)

    def close(self) -> None:
        """Leave the robot."""
        self._cells.leave()
        self._loop.call_soon_threadsafe(self._leaving.set)
        self._thread.join(timeout=ENDS_S)


class RealStation:
    """A MAVLink station on a socket; `restart` gives it a new port."""

    def __init__(self, name: str, journal: Journal, port: int) -> None:
        self._name, self._journal, self._port = name, journal, port
        self._sent: dict[int, tuple[tuple[float, ...], int]] = {}
        self._scope = ExitStack()
        self._start()

    def _start(self) -> None:
        """Start a client from a new port, which sends a heartbeat at once."""
        client = MavlinkClient(UdpLine(self._port), system=CLIENTS[self._name])
        client.takes = self._take
        self._client = self._scope.enter_context(client)

    def do(self, verb: str, arguments: Arguments) -> None:
        """Send a command."""
        if verb == "restart":
            self._scope.close()
            self._start()
            return
        if verb not in SENT:
            return
        deed = self._journal.begin(self._name, verb, arguments)
        deed.ended_ns = deed.began_ns
        if verb == "drive":
            self._ask(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1.0)
            x_m, y_m = (float(one) for one in arguments[:2])
            self._client.send(reposition(x_m, y_m))
        else:
            number, *params = SENT[verb](*arguments)
            self._ask(int(number), *params)

    def _ask(self, number: int, *params: float) -> None:
        self._sent[number] = params, self._journal.scheduler.now_ns
        self._client.send(command(number, *params))

    def _take(self, message: Any) -> None:
        kind = message.get_type()
        if kind == "COMMAND_ACK" and message.command in self._sent:
            params, since_ns = self._sent.pop(message.command)
            ack = Ack(message.command, params, message.result, since_ns)
            self._journal.say(self._name, ack)
        elif kind == "STATUSTEXT":
            self._journal.say(self._name, ShownText("text", message.text.rstrip("\0")))

    def close(self) -> None:
        """Be silent from now on."""
        self._scope.close()


SENT: Final[dict[str, Callable[..., tuple[float, ...]]]] = {
    "arm": lambda: (mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1.0),
    "disarm": lambda *_: (mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0.0),
    "mode": lambda name: (mavlink.MAV_CMD_DO_SET_MODE, 1.0, float(Mode[str(name)])),
    "pause": lambda goes_on: (mavlink.MAV_CMD_DO_PAUSE_CONTINUE, float(goes_on)),
    "stop": lambda: (mavlink.MAV_CMD_DO_FLIGHTTERMINATION, 1.0),
    "clear": lambda *_: (mavlink.MAV_CMD_DO_FLIGHTTERMINATION, 0.0),
    "drive": lambda *_: (),
    "restart": lambda: (),
}
"""The commands of a MAVLink station: number and parameters."""


def beside_up(seed: int, seconds: float) -> tuple[tuple[InvariantViolation, ...], Journal]:
    """Run `up` and the programs of persons for some time; return the contradictions."""
    with TemporaryDirectory(prefix="sidestep-") as folder, ExitStack() as ends:
        world = Path(folder) / "plain.toml"
        world.write_text(WORLD, encoding="utf-8")
        os.environ["XDG_STATE_HOME"] = folder  # no other run is here
        os.environ["SIDESTEP_PERSON"] = "ada"
        journal = Journal(WallTime())  # type: ignore[arg-type]  # only its time is asked
        port = free_port(socket.SOCK_DGRAM)
        up = ends.enter_context(running_up(journal, str(world), port))
        until(lambda: bool(read_runs().found) or up.poll() is not None, "`up` runs")
        where = common(None, None, None)
        bus = ends.enter_context(open_bus(where.network, Role.GROUND, "r1"))
        truth = TruthOfBus(journal.scheduler, journal, 1500.0)
        for topic in (STATUS, LEASE, MISSION, TRUTH):
            bus.stream(topic, truth.take, "r1")
        until(lambda: len(truth.rows) > 1, "a status arrives")
        programs: dict[str, Any] = {
            name: PersonsTerminal(name, journal, os.environ) for name in TERMINALS[:2]
        }
        programs[NOTEBOOK] = RealNotebook(NOTEBOOK, journal, where.endpoint)
        programs[STATION] = RealStation(STATION, journal, port)
        for program in programs.values():
            ends.callback(program.close)
        programs[TERMINALS[0]].do("take", ())  # `up` goes on while an operator has the lease
        until(lambda: bool(truth.rows[-1].holder) or up.poll() is not None, "the lease is taken")
        began_s = time.monotonic()
        for at_s, name, verb, arguments in deeds_of(seed, seconds):
            wait_until(began_s + at_s)
            if up.poll() is not None:
                break
            if name in programs:
                programs[name].do(verb, arguments)
        wait_until(began_s + seconds)
        found = contradictions(truth, journal, ())
    return found, journal


def wait_until(time_s: float) -> None:
    """Wait until a monotonic time."""
    threading.Event().wait(max(0.0, time_s - time.monotonic()))


def deeds_of(seed: int, seconds: float) -> Iterator[tuple[float, str, str, Arguments]]:
    """Yield deeds with their times: program, verb and arguments."""
    random = Random(f"beside {seed}")
    tables = {
        **dict.fromkeys(TERMINALS[:2], SHELL),
        NOTEBOOK: CELLS,
        STATION: tuple(row for row in SENT_BY_STATIONS if row[1](Random(0))[0] in SENT),
    }
    at_s = BEGIN_S
    while at_s < seconds - LAST_S:
        name = random.choice(tuple(tables))
        verb, *arguments = draw(random, tables[name])
        yield at_s, name, str(verb), tuple(arguments)
        at_s += random.choice((0.3, 1.5, 3.0))


@contextmanager
def running_up(journal: Journal, world: str, port: int) -> Iterator["subprocess.Popen[str]"]:
    """Run `up --headless`, and note its words."""
    deed = journal.begin(UP, "up", GOAL)
    words = (
        *("up", "--headless", "--json", "--world", world),
        *("--mavlink", f"udpin:127.0.0.1:{port}"),
    )
    process = subprocess.Popen(
        [sys.executable, "-m", "sidestep", *words],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        stdin=subprocess.DEVNULL,
        text=True,
    )

    def read() -> None:
        assert process.stderr is not None
        assert process.stdout is not None
        for line in process.stderr:
            journal.say(UP, ShownText("line", line.rstrip()), deed)
        outcome = None
        with suppress(ValueError):
            outcome = outcome_in(json.loads(process.stdout.read()))
        if deed.cancelled_ns is None:
            journal.end(deed, EndedCommand(process.wait(), outcome))
            journal.say(UP, outcome, deed)

    threading.Thread(target=read, daemon=True).start()
    try:
        yield process
    finally:
        journal.cancel(deed)
        process.send_signal(signal.SIGINT)
        with suppress(subprocess.TimeoutExpired):
            process.wait(ENDS_S)
        process.kill()


CONTRADICTIONS: Final = Campaign(
    "contradictions", draw_persons, observe, DEFECTS, failure="seeds with a contradiction"
)
BESIDE_S: Final = 60.0


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of `bench contradictions`."""
    campaign.add_options(parser, CONTRADICTIONS)
    parser.add_argument(
        "--beside",
        nargs="?",
        type=float,
        const=BESIDE_S,
        metavar="S",
        help=f"beside a real `up`, for so many seconds ({BESIDE_S:g}); --seed S draws other deeds",
    )


def measure(options: argparse.Namespace) -> BenchmarkReport:
    """Run one scenario, many seeds, the search for defects, or programs beside a real `up`."""
    if options.beside is None:
        return campaign.measure(options, CONTRADICTIONS)
    found, journal = beside_up(options.seed or 0, options.beside)
    return BenchmarkReport(
        benchmark=CONTRADICTIONS.name,
        figures=(
            figure("deeds beside a real `up`", len(journal.deeds)),
            figure("words that were judged", len(journal.words)),
            figure("contradictions", len(found), at_most=0),
        ),
        notes=tuple(
            f"{one.time_ns / NS_PER_S:.1f} s «{one.invariant}»: {one.words}" for one in found
        ),
    )
