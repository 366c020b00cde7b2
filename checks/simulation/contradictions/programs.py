"""The programs of persons: the product's own, with what they say noted.

A command of a shell is a process of its own, as in a terminal. A notebook is an asyncio program
with the Python API. The app is the ground station's model, polled, with band and log. `up` follows
the goal of its run. A MAVLink station may come back from a new port. Each program has a host whose
name begins with its person.
"""

import asyncio
from collections.abc import Callable, Coroutine, Sequence
from dataclasses import replace
from functools import partial
from math import degrees
from struct import unpack_from
from typing import Any, Final, NamedTuple

from greenlet import GreenletExit

from checks.simulation.contradictions.truth import Deed, EndedCommand, Journal, ShownText, person_of
from checks.simulation.hosts.bus import SimulatedNetwork
from checks.simulation.hosts.mavlink import ACTIONS, GatewaySide, SimulatedClient
from checks.simulation.hosts.operators import DIALS, RequestHistory
from checks.simulation.hosts.virtual_time import (
    Argument,
    Host,
    Scheduler,
    SimulatedClock,
    SimulatedLoop,
    Task,
    current_host,
)
from gateways.mavlink.mavlink_dialect import mavlink
from ground.app.stops.band import BandKeys, stop_band
from ground.cli import operate
from ground.client.connection import Common
from ground.client.goal import destination
from ground.client.lease_holder import operator_name
from ground.client.outcomes import Operation, Outcome
from ground.client.robot_link import open_link
from ground.client.vocabulary import HINTS
from ground.commands.abort import Abort
from ground.commands.arm import Arm
from ground.commands.disarm import Disarm
from ground.commands.goto import Goto
from ground.commands.hold import Hold
from ground.commands.lease import ChangeLease, ShowLease
from ground.commands.mission import StartMission, UploadMission
from ground.commands.mode import SetMode
from ground.commands.resume import Resume
from ground.commands.stop import ClearEmergencyStop, StopNow
from ground.commands.teleop import DriveByHand
from ground.launch.fleet_run import FleetRun, goal_runs_of
from ground.launch.scenario import Scenario, ScenarioRobot
from ground.missions.mission import Mission, Waypoint
from ground.robot import Robot, connect
from ground.station.station import Station
from ground.text.wording import Part, in_words
from protocol.bus.bus import Bus, open_bus
from protocol.bus.network import Network
from protocol.topics import Role
from protocol.wire.enums import LeaseAction, Mode
from protocol.world import GoalPose, Start, World, WorldRun
from runtime.errors import LocalError, RemoteError
from runtime.units import NS_PER_MS, NS_PER_S

INTERRUPTED: Final = 130
"""Exit code of a command that Ctrl-C has ended."""

POLL_NS: Final = 50 * NS_PER_MS
WIDTH, HEIGHT = 200, 50
Arguments = tuple[Argument, ...]


def common_here(*_: object, **more: Any) -> Common:
    """Return how the program of the running host reaches the robot."""
    return Common(network=network_of(person_of(current_host().name)), robot="r1", **more)


def network_of(person: str) -> Network:
    """Return the network of a person's programs."""
    return replace(DIALS, person=person)


def open_bus_here(network: Network, role: Role, robot: str) -> Bus:
    """Open a bus with the clock of the running host."""
    return open_bus(network, role, robot, current_host().now_ns)


class PersonsProgram:
    """A program of a person."""

    def __init__(self, scheduler: Scheduler, name: str, journal: Journal) -> None:
        self.name = name
        self.host = Host(scheduler, name)
        self.host.alive = False
        self.journal = journal
        self.scheduler = scheduler
        self.starts = 0

    def new_host(self) -> Host:
        """Return the host of a new process."""
        self.starts += 1
        seconds = 700 + 13 * self.starts + len(self.name)
        self.host = Host(self.scheduler, self.name, seconds * NS_PER_S)
        return self.host

    def do(self, verb: str, arguments: Arguments) -> None:
        """Do what a person asks."""
        raise NotImplementedError

    def cancel(self) -> None:
        """End early what is under way."""

    def kill(self) -> None:
        """Kill the process."""
        if self.host.alive:
            self.host.alive = False
            if (session := self.session) is not None:
                session.close()
            self.host.kill()
            self.journal.killed(self.name)

    @property
    def session(self) -> Any:
        """The session on the bus, or None."""
        return None

    def errors(self) -> list[Host]:
        """Return the hosts whose code may have failed."""
        return [self.host]


class Telling:
    """The progress display of a command: each new text is a word."""

    live = False

    def __init__(self, journal: Journal, deed: Deed) -> None:
        self._journal, self._deed = journal, deed

    def note(self, text: str) -> None:
        """Say a note."""
        self._journal.say(self._deed.program, ShownText("note", text), self._deed)

    def line(self, parts: Sequence[Part]) -> None:
        """Say the status line."""
        self._journal.say(self._deed.program, ShownText("line", in_words(parts)), self._deed)


def operation_of(verb: str, arguments: Arguments) -> Operation[Outcome]:
    """Return the operation of a verb, as a person types it."""
    return OPERATIONS[verb](*arguments)


def goto(x_m: float, y_m: float, timeout_s: float = 0.0) -> Operation[Outcome]:
    """Return the operation of `goto X Y --timeout S`."""
    return Goto(goal=destination([x_m, y_m]), timeout_s=timeout_s or None)


def mission_at(*places: float) -> Mission:
    """Return a mission with these stops."""
    stops = zip(places[::2], places[1::2], strict=True)
    return Mission(waypoints=tuple(Waypoint(x_m=x_m, y_m=y_m) for x_m, y_m in stops))


OPERATIONS: Final[dict[str, Callable[..., Operation[Outcome]]]] = {
    "goto": goto,
    "drive": lambda speed_m_s, turn_rad_s, for_s: DriveByHand(
        speed_m_s=speed_m_s, turn_deg_s=degrees(turn_rad_s), for_s=for_s
    ),
    "upload": lambda *places: UploadMission(mission=mission_at(*places)),
    "start": lambda: StartMission(),
    "arm": Arm,
    "disarm": Disarm,
    "hold": Hold,
    "resume": Resume,
    "abort": Abort,
    "mode": lambda name: SetMode(mode=Mode[name]),
    "estop": StopNow,
    "clear": ClearEmergencyStop,
    "take": lambda: ChangeLease(action=LeaseAction.TAKE, for_s=2.0),
    "seize": lambda: ChangeLease(action=LeaseAction.SEIZE, for_s=2.0),
    "release": lambda: ChangeLease(action=LeaseAction.RELEASE),
    "lease": ShowLease,
}


class Shell(PersonsProgram):
    """A terminal: each command is a process, and several may run at once."""

    def __init__(self, scheduler: Scheduler, name: str, journal: Journal) -> None:
        super().__init__(scheduler, name, journal)
        self._running: dict[Host, tuple[Deed, Task]] = {}
        self._cancels: dict[Host, Callable[[], object]] = {}
        """Cancels the task of a command, once its event loop runs."""

        self._hosts: list[Host] = []

    def do(self, verb: str, arguments: Arguments) -> None:
        """Run a command."""
        host = self.new_host()
        host.name = f"{self.name}.{self.starts}"
        deed = self.journal.begin(host.name, verb, arguments)
        self._running[host] = deed, host.spawn(partial(self._run, deed))
        self._hosts.append(host)

    def _run(self, deed: Deed) -> None:
        try:
            ended = self._perform(deed)
        except GreenletExit:
            raise
        except (KeyboardInterrupt, asyncio.CancelledError):
            ended = EndedCommand(INTERRUPTED)
        except (RemoteError, LocalError) as error:
            ended = EndedCommand(getattr(error, "exit_code", 1), None, str(error))
        self.journal.end(deed, ended)
        self._running.pop(current_host(), None)
        self._cancels.pop(current_host(), None)

    def _perform(self, deed: Deed) -> EndedCommand:
        operation = operation_of(deed.verb, deed.arguments)
        with open_link(common_here()) as link:
            robot = operate.robot_of(link, Telling(self.journal, deed))
            outcome: Outcome = SimulatedLoop().run(self._carry_out(operation, robot))
            if deed.cancelled_ns is not None:
                raise KeyboardInterrupt
            self.journal.say(deed.program, outcome, deed)
            return EndedCommand(0 if outcome.ok else 1, outcome)

    async def _carry_out(self, operation: Any, robot: Robot) -> Outcome:
        task: Any = asyncio.current_task()
        self._cancels[current_host()] = partial(
            asyncio.get_running_loop().call_soon_threadsafe, task.cancel
        )
        if isinstance(operation, StopNow):
            await robot.open()
        outcome: Outcome = await operate.perform(operation, robot)
        return outcome

    def cancel(self) -> None:
        """Press Ctrl-C for the newest command."""
        for deed, task in reversed(self._running.values()):
            if deed.cancelled_ns is None:
                self.journal.cancel(deed)
                if (cancel := self._cancels.get(task.host)) is None:
                    task.interrupt(KeyboardInterrupt())  # it dials
                else:
                    task.host.call(cancel)
                return

    def kill(self) -> None:
        """Close the terminal."""
        for host in list(self._running):
            host.kill()
            self.journal.killed(host.name)
        self._running.clear()

    def errors(self) -> list[Host]:
        """Return the hosts of all commands."""
        return self._hosts


class Cells:
    """The cells of a program with the Python API, each a task of its event loop.

    `then` cancels what is under way and begins at once.
    """

    def __init__(self, name: str, journal: Journal) -> None:
        self._name, self._journal = name, journal
        self._under_way: list[tuple[Deed, asyncio.Task[None]]] = []

    def begin(self, robot: Robot, verb: str, arguments: Arguments) -> None:
        """Run a cell in the running loop, without a wait for its end."""
        if verb == "then":
            self._cancel_newest()
            verb, arguments = str(arguments[0]), arguments[1:]
        if verb == "cancel":
            self._cancel_newest()
        elif verb in CELLS:
            deed = self._journal.begin(self._name, verb, arguments)
            work = asyncio.get_running_loop().create_task(self._perform(robot, deed))
            self._under_way.append((deed, work))

    def leave(self) -> None:
        """Note that the end of the program cancels what is under way."""
        for deed, _ in self._under_way:
            self._journal.cancel(deed)

    def _cancel_newest(self) -> None:
        self._under_way = [one for one in self._under_way if not one[1].done()]
        for deed, work in reversed(self._under_way):
            if deed.cancelled_ns is None:
                self._journal.cancel(deed)
                work.cancel()
                return

    async def _perform(self, robot: Robot, deed: Deed) -> None:
        try:
            value: Any = await CELLS[deed.verb](robot, *deed.arguments)
        except asyncio.CancelledError:
            value = "cancelled"
        except TimeoutError:
            value = "time limit"
        except (RemoteError, LocalError) as error:
            value = error
        self._journal.end(deed, value)


class Notebook(PersonsProgram):
    """A program with the Python API."""

    def __init__(self, scheduler: Scheduler, name: str, journal: Journal) -> None:
        super().__init__(scheduler, name, journal)
        self._loop: SimulatedLoop | None = None
        self._robot: Robot | None = None
        self._cells = Cells(name, journal)

    def start(self) -> None:
        """Start the program."""
        if not self.host.alive:
            self.new_host().spawn(self._main)

    def _main(self) -> None:
        loop = self._loop = SimulatedLoop()
        self._robot, self._cells = None, Cells(self.name, self.journal)
        loop.run(self._program())

    async def _program(self) -> None:
        self._leaving = asyncio.Event()
        async with connect() as robot:
            self._robot = robot
            await self._leaving.wait()
            self._robot = None

    def do(self, verb: str, arguments: Arguments) -> None:
        """Run a cell, which does not wait for its end."""
        if self.host.alive and self._loop is not None and self._robot is not None:
            self.host.call(self._loop.call_soon_threadsafe, self._begin, verb, arguments)

    def _begin(self, verb: str, arguments: Arguments) -> None:
        if self._robot is None:
            return
        if verb == "leave":
            self._cells.leave()
            self._leaving.set()
        else:
            self._cells.begin(self._robot, verb, arguments)

    def cancel(self) -> None:
        """Cancel the newest task."""
        self.do("cancel", ())

    @property
    def session(self) -> Any:
        """The session of the client."""
        return None if self._robot is None else self._robot.bus._session


async def limited(robot: Robot, x_m: float, y_m: float, limit_s: float) -> object:
    """Drive with a time limit of asyncio."""
    return await asyncio.wait_for(robot.goto(x_m, y_m), limit_s)


async def drive_mission(robot: Robot, *places: float) -> object:
    """Upload a mission and drive it to its end."""
    uploaded = await robot.mission.upload(mission_at(*places))
    return await robot.mission.run() if uploaded.ok else uploaded


CELLS: Final[dict[str, Callable[..., Coroutine[Any, Any, Any]]]] = {
    "goto": lambda robot, x_m, y_m, timeout_s=0.0: robot.goto(
        x_m, y_m, timeout_s=timeout_s or None
    ),
    "limited": limited,
    "drive": lambda robot, speed_m_s, turn_rad_s, for_s: robot.drive(
        speed_m_s, degrees(turn_rad_s), for_s=for_s
    ),
    "mission": drive_mission,
    "arm": Robot.arm,
    "disarm": Robot.disarm,
    "hold": Robot.hold,
    "resume": Robot.resume,
    "abort": Robot.abort,
    "estop": Robot.emergency_stop,
    "clear": Robot.clear_emergency_stop,
    "take": lambda robot: robot.lease.take(),
    "seize": lambda robot: robot.lease.seize(),
    "release": lambda robot: robot.lease.give_back(),
    "lease": lambda robot: robot.lease.show(),
}


class Typed(NamedTuple):
    """A command that a person has typed, whose outcome is noted."""

    command: Operation[Outcome]
    deed: Deed
    journal: Journal

    async def perform(self, robot: Robot) -> Outcome:
        """Perform it."""
        command: Any = self.command
        outcome: Outcome = await command.perform(robot)
        self.journal.end(self.deed, outcome)
        return outcome


class App(PersonsProgram):
    """The ground station without its screen: it shows lease, loss, band and log."""

    station: Station | None = None

    def start(self) -> None:
        """Start the app."""
        if not self.host.alive:
            self.new_host().spawn(self._main)

    def _main(self) -> None:
        common, clock = common_here(), SimulatedClock()
        bus = self._bus = open_bus_here(common.network, Role.GROUND, "r1")
        name = operator_name(None)
        station = self.station = Station(bus, "r1", clock, name=name, common=common)
        station.queue.hints = HINTS
        self._shown: dict[str, object] = {}
        self._lines, self._since_ns, self._vehicle = 0, None, None
        self._loop = SimulatedLoop()
        self._loop.run(self._polling(station))

    async def _polling(self, station: Station) -> None:
        while True:
            station.poll()
            self._tell(station)
            await asyncio.sleep(POLL_NS / NS_PER_S)

    def do(self, verb: str, arguments: Arguments) -> None:
        """Type a command."""
        station = self.station
        if station is None or not self.host.alive:
            return
        deed = self.journal.begin(self.name, verb, arguments)
        self.host.call(self._loop.call_soon_threadsafe, self._type, station, deed)

    def _type(self, station: Station, deed: Deed) -> None:
        if deed.verb == "estop":
            station.estop()
        elif deed.verb in ("take", "seize", "release"):
            station.queue.lease(LeaseAction[deed.verb.upper()])
        else:
            verbs = ("upload", "start") if deed.verb == "mission" else (deed.verb,)
            for verb in verbs:
                operation = operation_of(verb, deed.arguments if verb != "start" else ())
                if isinstance(operation, ClearEmergencyStop):
                    operation = replace(operation, stop_ids=station.stops_known("r1"))
                typed = Typed(operation, deed, self.journal)
                station.queue.submit(str(deed), typed, moves=operation.moves)

    def _tell(self, station: Station) -> None:
        """Say everything that is shown and has changed; a loss and a band count the time."""
        for line in station.log.since(self._lines):
            self.journal.say(self.name, ShownText("log", line.text))
        self._lines = station.log.total
        loss = station.loss()
        band = stop_band(station, None, BandKeys(lambda action: action), WIDTH, HEIGHT)
        rows = " ".join("".join(span.text for span in one) for one in band.rows)
        shown: dict[str, object] = {
            "lease": station.lease._replace(lapses_s=0.0),
            "loss": ShownText("loss", "" if loss is None else loss.words),
            "band": ShownText("band", " ".join(rows.split())),
        }
        for part, value in shown.items():
            if self._shown.get(part) != value:
                self._shown[part] = value
                self.journal.say(self.name, value)

    @property
    def session(self) -> Any:
        """The session of the station."""
        return None if self.station is None else self._bus._session


class Up(PersonsProgram):
    """`up --headless`, whose processes are the simulated ones: it drives to its goal and ends."""

    def do(self, verb: str, arguments: Arguments) -> None:
        """Start it; the verb is `up`."""
        if not self.host.alive:
            deed = self.journal.begin(self.name, verb, arguments)
            self.new_host().spawn(partial(self._main, deed))

    def _main(self, deed: Deed) -> None:
        x_m, y_m = (float(one) for one in deed.arguments[:2])
        goal = destination([x_m, y_m])
        world = World(
            name="plain",
            size_m=(60.0, 60.0),
            start=Start(x_m=30.0, y_m=30.0),
            goal=GoalPose(x_m=30.0, y_m=30.0),
        )
        scenario = Scenario(
            world="plain",
            name="plain",
            run=WorldRun(world=world),
            scenario_robots=(ScenarioRobot(robot="r1", start=(30.0, 30.0, 0.0), goal=goal),),
            navigator="bug2",
            side="left",
            seed=0,
            noise=None,
            speed="1",
            router=False,
            record=None,
            timeout_s=100.0,
            clock="wall",
        )
        common, clock = common_here(), SimulatedClock()
        bus = self._bus = open_bus_here(common.network, Role.GROUND, "r1")
        runs = goal_runs_of(scenario, common, bus, clock, lambda: None)
        run = FleetRun(runs, clock, lambda: None, partial(self._line, deed))
        try:
            (outcome,) = SimulatedLoop().run(run.run(lockstep=False))
            ended = EndedCommand(0 if outcome.reached else 1, outcome)
        except (RemoteError, LocalError) as error:
            ended = EndedCommand(getattr(error, "exit_code", 1), None, str(error))
        self.journal.end(deed, ended)
        bus.close()
        self.host.alive = False

    def _line(self, deed: Deed, parts: Sequence[Part]) -> None:
        self.journal.say(self.name, ShownText("line", in_words(parts)), deed)

    @property
    def session(self) -> Any:
        """The session of `up`."""
        return self._bus._session


TEXT_START: Final = mavlink.MAVLINK_MSG_ID_STATUSTEXT.to_bytes(3, "little")
ACK_START: Final = mavlink.MAVLINK_MSG_ID_COMMAND_ACK.to_bytes(3, "little")
TEXT_BYTES: Final = 50


class Ack(NamedTuple):
    """An acknowledgement that a station has received for a command under way."""

    number: int
    params: tuple[float, ...]
    result: int
    since_ns: int
    """When the command was sent."""


class StationClient(SimulatedClient):
    """The client of the simulation, of which commands and answers are noted."""

    def __init__(
        self, station: "MavlinkStation", network: SimulatedNetwork, gateway: GatewaySide
    ) -> None:
        super().__init__(station.scheduler, network, gateway, station.name, RequestHistory())
        self.host, self._station = station.host, station
        self._text = ""
        self._sent: list[tuple[int, tuple[float, ...], int]] = []

    def _put(self, data: bytes, peer: str, kind: str = "", *, is_loopback: bool = True) -> None:
        """Send from the port of now."""
        super()._put(data, self._station.peer, kind, is_loopback=is_loopback)

    def _command(self, kind: str, number: int, *params: float) -> bool:
        """Send a command, and note it while it is under way."""
        one = number, params, self._scheduler.now_ns
        self._sent.append(one)
        try:
            return super()._command(kind, number, *params)
        finally:
            self._sent.remove(one)

    def receive(self, data: bytes) -> None:
        """Receive a frame: say an acknowledgement or a text."""
        super().receive(data)
        body = data[10:-2]
        if data[7:10] == ACK_START:
            number, result = unpack_from("<HB", body.ljust(3, b"\0"))
            of_it = [one for one in self._sent if one[0] == number]
            repeats_stop = self._is_stopping and number == mavlink.MAV_CMD_DO_FLIGHTTERMINATION
            if len(of_it) == 1 and not repeats_stop:  # of two alike it is not known which is meant
                (_, params, since_ns) = of_it[0]
                self._station.say(Ack(number, params, result, since_ns))
        elif data[7:10] == TEXT_START:
            self._receive_text(body.ljust(TEXT_BYTES + 4, b"\0"))

    def _receive_text(self, body: bytes) -> None:
        """Say a text when its last piece has arrived: the one that is not full."""
        text, has_more = body[1 : 1 + TEXT_BYTES], body[TEXT_BYTES] and any(body[TEXT_BYTES + 1 :])
        self._text += text.partition(b"\0")[0].decode(errors="replace")
        if not has_more:
            self._station.say(ShownText("text", self._text))
            self._text = ""


class MavlinkStation(PersonsProgram):
    """A station; `restart` ends it and starts it again with the same ids, at a new port."""

    def __init__(
        self,
        scheduler: Scheduler,
        name: str,
        journal: Journal,
        network: SimulatedNetwork,
        gateway: GatewaySide,
    ) -> None:
        super().__init__(scheduler, name, journal)
        self._network, self._gateway = network, gateway
        self._client: StationClient | None = None

    @property
    def peer(self) -> str:
        """The port from which it sends now."""
        return f"{self.name}:{self.starts}"

    def start(self) -> None:
        """Start the station."""
        if not self.host.alive:
            self.new_host()
            self._client = StationClient(self, self._network, self._gateway)
            self._client.start()

    def do(self, verb: str, arguments: Arguments) -> None:
        """Do what a person asks."""
        if verb == "restart":
            self.kill()
            self.start()
        elif self._client is not None and self.host.alive:
            deed = self.journal.begin(self.name, verb, arguments)
            self.host.spawn(lambda: self._act(deed, arguments))

    def _act(self, deed: Deed, arguments: tuple[Argument, ...]) -> None:
        ACTIONS[deed.verb](self._client, *arguments)
        deed.ended_ns = self.scheduler.now_ns

    def receive(self, data: bytes) -> None:
        """Receive a frame of the gateway."""
        if self._client is not None:
            self._client.receive(data)

    def say(self, value: Any) -> None:
        """Say what the station is told."""
        self.journal.say(self.name, value)

    def errors(self) -> list[Host]:
        """Return its host."""
        return [self.host]
