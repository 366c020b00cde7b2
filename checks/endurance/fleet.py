"""The fleet of a soak: its processes, its faults and their times, its telemetry and its drives.

The processes are those of `up`, two operators and a recorder; some are behind proxies. Each fault
is caused once per round, in an order drawn by seed. Telemetry shows the delay from senses to
commands, missed ticks and silent robots.

A robot keeps driving whatever happens to it, even after it has lost its position. Each goal is
relative to the estimated position: straight on after a goal was reached, else in another direction.
So a robot that was restarted on its way continues like the others.

Beside them runs a supervisor in a process of its own, to measure its growth and that of its plant:
`python -m checks.endurance.fleet PARENT WORLD` starts a robot and a plant as `up` does, prints the
plant's process id, kills the robot once a minute, and restarts it until its standard input ends.
The plant of the fleet is killed too often to be judged.
"""

import json
import os
import signal
import subprocess
import sys
import threading
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, suppress
from math import cos, sin
from pathlib import Path
from random import Random
from typing import IO, Final, NamedTuple, Self

from checks.flood.attackers import Access, Attack
from checks.harness.processes import arm_request, is_accepted
from checks.harness.relays import TcpProxy
from ground.cli.main import parse
from ground.cli.run.up import free_endpoint
from ground.client.goal import Destination, goal_request
from ground.client.requests import RequestIds
from ground.launch.child_command import die_with_parent
from ground.launch.child_processes import Children
from ground.launch.scenario import (
    Scenario,
    process_arguments,
    run_of,
    scenario_of,
)
from ground.launch.supervisor import RestartSchedule, Supervisor
from protocol.bus.bus import Bus, open_bus
from protocol.bus.network import Network
from protocol.topics import COMMAND, CYCLE, DRIVE, ODOMETRY, SONAR, STATUS, Role
from protocol.wire.codec import decode
from protocol.wire.enums import GoalState, Mode, Vehicle
from protocol.wire.message import Message
from protocol.wire.messages import (
    CycleReport,
    NavigatorStatus,
    PlanarOdometry,
    SonarScan,
    WheelCommand,
)
from runtime.clock import Clock, WallClock
from runtime.errors import RemoteError
from runtime.units import NS_PER_S

RESTS: Final = 0.15
"""Share of a run at its end, at most half a minute, without faults."""
LONGEST_REST_S: Final = 30.0
PACE_S: Final = 20.0
FEWEST: Final = 5
FLOOD_HZ: Final = 1000.0


class SoakFault(NamedTuple):
    """A fault of a process: signals at its begin and end, a cut link, or a flood of frames.

    Without a signal the link of `role` is cut for `lasts_s`, or an attacker puts `flood_hz` frames
    a second on the keys of r1, some of them forged.
    """

    name: str
    role: str
    first: signal.Signals | None
    then: signal.Signals | None = None
    lasts_s: float = 0.0
    flood_hz: float = 0.0


KILLED: Final = ("robot r2", "plant", "router", "ground r2")
STOPPED: Final = ("robot r3", "plant")
CUT: Final = ("robot r1", "recorder r1")
"""These processes are never killed, so that their growth over the whole run can be measured."""


def faults(roles: list[str]) -> list[SoakFault]:
    """Return all faults of these roles."""
    found = [SoakFault(f"{role} killed", role, signal.SIGKILL) for role in KILLED]
    found += [
        SoakFault(f"{role} stopped for 2 s", role, signal.SIGSTOP, signal.SIGCONT, 2.0)
        for role in STOPPED
    ]
    found += [SoakFault(f"{role} cut off for 4 s", role, None, None, 4.0) for role in CUT]
    found.append(SoakFault(f"flood of {FLOOD_HZ:g} frames/s", "router", None, None, 3.0, FLOOD_HZ))
    return [fault for fault in found if fault.role in roles]


def schedule(
    faults: list[SoakFault], seconds: float, seed: int
) -> Iterator[tuple[float, SoakFault]]:
    """Yield the faults with their times in seconds from the beginning."""
    random = Random(seed)
    end_s = seconds - min(LONGEST_REST_S, RESTS * seconds)
    pace_s = min(PACE_S, seconds / (FEWEST + 1))
    at_s = pace_s
    while faults:
        for fault in random.sample(faults, len(faults)):
            if at_s + fault.lasts_s > end_s:
                return
            yield at_s, fault
            at_s += pace_s * random.uniform(0.8, 1.2)


LISTENS_S: Final = 15.0
PAGE_MB: Final = os.sysconf("SC_PAGESIZE") / 1e6


class Size(NamedTuple):
    """The resident memory, open files and threads of a process, from the kernel."""

    rss_mb: float
    files: float
    threads: float


class SoakFleet:
    """The processes of `up` with a router; those that end are restarted as `up` restarts them."""

    def __init__(self, world: str, robots: int, seed: int, folder: Path, clock: Clock) -> None:
        words = ["up", "--headless", "--clock", "wall", "--router", "--world", world]
        options = parse([*words, "--robots", str(robots), "--seed", str(seed)])
        self.scenario: Scenario = scenario_of(options, run_of(options))
        self.endpoint = free_endpoint()
        self._world = world
        self._folder = folder
        self._clock = clock
        self._scope = ExitStack()
        self._proxies: dict[str, TcpProxy] = {}
        self._words: dict[str, list[str]] = {}

    def __enter__(self) -> Self:
        with self._scope:
            self._attacks = self._scope.enter_context(ExitStack())
            self._children = self._scope.enter_context(Children(self._clock))
            self._words = self._cast()
            for role, words in self._words.items():
                self._children.start(role, words)
            supervisor = RestartSchedule(self._words)
            self._upkeep = Supervisor(self._children, supervisor, None, self._again)
            self._supervised = self._scope.enter_context(Supervised(self._world))
            network = Network(mode="client", connect=(self.endpoint,), connect_timeout_s=LISTENS_S)
            self.bus: Bus = self._scope.enter_context(open_bus(network, Role.GROUND, "r1"))
            self._scope = self._scope.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        self._scope.close()

    @property
    def roles(self) -> list[str]:
        """The names of the processes."""
        return list(self._words)

    @property
    def given_up(self) -> list[str]:
        """The messages about processes that ended too often."""
        return list(self._upkeep.schedule.given_up.values())

    def look_after(self) -> None:
        """Restart the processes that have ended."""
        self._upkeep.round(self._clock.now_ns())

    def do(self, fault: SoakFault) -> None:
        """Begin a fault."""
        if fault.flood_hz:
            self._attack(fault.flood_hz)
        elif fault.first is None:
            self._proxies[fault.role].cut()
        else:
            self._children.send(fault.role, fault.first)

    def undo(self, fault: SoakFault) -> None:
        """End a fault."""
        if fault.flood_hz:
            self._attacks.close()
        elif fault.first is None:
            self._proxies[fault.role].restore()
        elif fault.then is not None:
            self._children.send(fault.role, fault.then)

    def _attack(self, rate_hz: float) -> None:
        with suppress(RuntimeError):  # it could not connect
            attack = self._attacks.enter_context(Attack("frames", Access(self.endpoint), rate_hz))
            attack.go()

    def sizes(self) -> dict[tuple[str, int], Size]:
        """Return sizes by role and process id, without processes that have just ended."""
        found = {}
        children = zip(self._children.roles, self._children.pids, strict=True)
        for role, pid in (*children, *self._supervised.pids.items()):
            size = size_of(pid)
            if size is not None:
                found[role, pid] = size
        return found

    def _cast(self) -> dict[str, list[str]]:
        words = dict(process_arguments(self.scenario, self.endpoint))
        dials = ["--connect", self.endpoint, "--id"]
        words["recorder r1"] = ["record", str(self._folder), *dials, "r1"]
        for robot in self.scenario.robots[:2]:
            words[f"ground {robot}"] = ["ground", "--plain", *dials, robot]
        for role in CUT:
            proxy = self._proxies[role] = self._scope.enter_context(TcpProxy(self.endpoint))
            words[role] = [
                proxy.endpoint if word == self.endpoint else word for word in words[role]
            ]
        return words

    def _again(self, role: str, cause: str) -> list[str]:
        words = self._words[role]
        return [*words, "--after", cause] if words[0] == "robot" else words


def size_of(pid: int) -> Size | None:
    """Return the size of a process; None if it has ended or belongs to another user."""
    place = Path(f"/proc/{pid}")
    try:
        pages = int((place / "statm").read_text().split()[1])
        files, threads = (len(list((place / name).iterdir())) for name in ("fd", "task"))
    except (OSError, IndexError):
        return None
    return Size(pages * PAGE_MB, files, threads)


REMEMBERED: Final = 64


class RobotTelemetry:
    """The streams of one robot as they arrive; filled in the bus's thread."""

    def __init__(self, began_ns: int) -> None:
        self._began_ns = began_ns
        self._scans: deque[tuple[int, int]] = deque(maxlen=REMEMBERED)
        self._tick: CycleReport | None = None
        self.status: NavigatorStatus | None = None
        self.pose: PlanarOdometry | None = None
        self._arrived_ns = {SonarScan: 0, NavigatorStatus: 0}
        self.delays_ms: list[tuple[float, float]] = []
        """Arrival of a command in s from the beginning, and its delay after the scan."""
        self.ticks: list[tuple[float, int]] = []
        """Arrival of a report, and the ticks missed since the report before."""

    def record(self, _key: str, frame: bytes, at_ns: int) -> None:
        """Record a frame; unreadable frames are ignored."""
        with suppress(RemoteError):
            self._record(decode(frame).message, at_ns)

    def _record(self, message: Message, at_ns: int) -> None:
        at_s = (at_ns - self._began_ns) / NS_PER_S
        if isinstance(message, SonarScan):
            self._scans.append((message.seq, at_ns))
            self._arrived_ns[SonarScan] = at_ns
        elif isinstance(message, WheelCommand):
            self.delays_ms += [
                (at_s, (at_ns - scan_ns) / 1e6)
                for seq, scan_ns in self._scans
                if seq == message.sense_seq
            ][-1:]
        elif isinstance(message, CycleReport):
            before, self._tick = self._tick, message
            if before is not None and message.tick > before.tick:
                self.ticks.append((at_s, message.missed - before.missed))
        elif isinstance(message, PlanarOdometry):
            self.pose = message
        elif isinstance(message, NavigatorStatus):
            self.status = message
            self._arrived_ns[NavigatorStatus] = at_ns

    def silent_since(self, at_ns: int) -> bool:
        """Return whether no status or no scan has arrived since then."""
        return min(self._arrived_ns.values()) <= at_ns


def subscribe(bus: Bus, robots: tuple[str, ...], began_ns: int) -> dict[str, RobotTelemetry]:
    """Record the telemetry of all robots from now on."""
    found = {robot: RobotTelemetry(began_ns) for robot in robots}
    for robot, telemetry in found.items():
        for topic in (SONAR, DRIVE, CYCLE, STATUS, ODOMETRY):
            bus.stream(topic, telemetry.record, robot)
    return found


PATIENCE_S: Final = 0.2
EVERY_NS: Final = 1_000_000_000
STEP_M: Final = 1.2
BACK_RAD: Final = 2.6
"""Not quite back, so that the robot does not drive to and fro between two walls."""
LONGEST_NS: Final = 12_000_000_000
UNDER_WAY: Final = (
    GoalState.ACCEPTED,
    GoalState.DRIVING,
    GoalState.AVOIDING,
    GoalState.ALIGNING,
)


class GoalSender:
    """Sends the next goal when the last has ended or takes too long; arms the robot if needed."""

    def __init__(self, bus: Bus, robot: str) -> None:
        self.robot = robot
        self.goals = self.reached = 0
        self._bus = bus
        self._ids = RequestIds()
        self._due_ns = 0
        self._given_ns = 0
        self._turn_rad = 0.0

    def poll(self, telemetry: RobotTelemetry, now_ns: int) -> None:
        """Send a goal if one is due, at most once a second and not while the robot is silent."""
        status, pose = telemetry.status, telemetry.pose
        if status is None or pose is None or now_ns < self._due_ns:
            return
        self._due_ns = now_ns + EVERY_NS
        if telemetry.silent_since(now_ns - EVERY_NS):
            return
        under_way = status.vehicle == Vehicle.ACTIVE and status.goal in UNDER_WAY
        if under_way and now_ns - self._given_ns < LONGEST_NS:
            return
        arrived = status.goal == GoalState.REACHED
        begins = self._given_ns == 0
        self.reached += arrived and not begins
        self._turn_rad = 0.0 if arrived or begins else self._turn_rad + BACK_RAD
        if status.vehicle != Vehicle.ACTIVE:
            self._ask(arm_request(self._ids.next()))
        if self._ask(self._goal(pose)):
            self.goals += 1
            self._given_ns = now_ns

    def _goal(self, pose: PlanarOdometry) -> Message:
        heading_rad = pose.heading_rad + self._turn_rad
        there = Destination(
            x_m=pose.x_m + STEP_M * cos(heading_rad),
            y_m=pose.y_m + STEP_M * sin(heading_rad),
            heading_rad=None,
        )
        return goal_request(there.on_the_wire(), self._ids.next(), Mode.AUTO, from_robot=True)

    def _ask(self, request: Message) -> bool:
        """Send a request and return whether it was accepted."""
        try:
            return is_accepted(self._bus.ask(COMMAND, request, PATIENCE_S, robot=self.robot))
        except RemoteError:
            return False


ROUND_S: Final = 0.1
KILL_NS: Final = 60_000_000_000
SUPERVISOR: Final = "supervisor"
PLANT: Final = "plant that is left alone"
VICTIM: Final = "robot r1"


class Supervised:
    """The supervisor process as its parent sees it; `pids` has the ids by name."""

    def __init__(self, world: str) -> None:
        words = [sys.executable, "-m", "checks.endurance.fleet", str(os.getpid()), world]
        self._process = subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE)
        self.pids: Mapping[str, int] = {}

    def __enter__(self) -> Self:
        out: IO[bytes] | None = self._process.stdout
        assert out is not None
        line = out.readline()
        if not line:
            raise RuntimeError("the supervisor did not start")
        self.pids = {SUPERVISOR: self._process.pid, PLANT: json.loads(line)["plant"]}
        return self

    def __exit__(self, *_: object) -> None:
        self._process.communicate()


def supervise(upkeep: Supervisor, children: Children, clock: Clock, over: threading.Event) -> None:
    """Restart what ends, and kill the robot once a minute."""
    killed_ns = clock.now_ns()
    while not over.wait(ROUND_S):
        now_ns = clock.now_ns()
        if now_ns - killed_ns >= KILL_NS:
            killed_ns = now_ns
            children.send(VICTIM, signal.SIGKILL)
        upkeep.round(now_ns)
        upkeep.next_event()


def await_end(over: threading.Event) -> None:
    """Set `over` when standard input ends."""
    sys.stdin.read()
    over.set()


def main(arguments: Sequence[str]) -> int:
    """Supervise a robot and a plant until standard input ends; return the exit code."""
    parent, world = arguments
    if not die_with_parent(int(parent)):
        return 1
    options = parse(["up", "--headless", "--clock", "wall", "--world", world])
    words = dict(process_arguments(scenario_of(options, run_of(options)), free_endpoint()))
    clock, over = WallClock(), threading.Event()
    with Children(clock) as children:
        for role, line in words.items():
            children.start(role, line)
        pids = dict(zip(children.roles, children.pids, strict=True))
        print(json.dumps({"plant": pids["plant"]}), flush=True)
        threading.Thread(target=await_end, args=(over,), daemon=True).start()
        upkeep = Supervisor(
            children, RestartSchedule(words), None, lambda role, _cause: words[role]
        )
        supervise(upkeep, children, clock, over)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
