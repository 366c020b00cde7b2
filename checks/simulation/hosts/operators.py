"""Operators of the simulation: with the one client of a robot, or at the ground station.

An operator is a process with an event loop: it runs its actions in turn, and its emergency stops at
once. Each request is drawn: it asks without the lease, too, and sends its heartbeat whether the
robot has another operator or none, as no program of ours does. The ground station is its model
without the screen, polled 20 times a second; lease, heartbeat and emergency stop are its own.
"""

import asyncio
from collections import deque
from collections.abc import Callable, Coroutine, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, Final, NamedTuple

from checks.simulation.hosts.virtual_time import (
    Argument,
    Host,
    Scheduler,
    SimulatedClock,
    SimulatedLoop,
)
from ground.client.connection import Common
from ground.client.emergency_stop import EmergencyStop
from ground.client.goal import destination, goal_request
from ground.client.missions import send
from ground.client.outcomes import Refused
from ground.client.parameters import ParameterExchange
from ground.client.requests import BEAT_NS
from ground.client.teleop_sender import TeleopSender
from ground.missions.mission import Circle, Polygon, Waypoint
from ground.missions.transfer import Clear, Upload, fence_items_of, items_of
from ground.robot import Robot
from ground.station.robot.command_queue import JobResult
from ground.station.station import Station
from protocol.bus.bus import Bus, open_bus
from protocol.bus.network import Network
from protocol.topics import COMMAND, LEASE_SERVICE, PARAMETER, STATUS, STOP, Role, Service
from protocol.wire.enums import PARAM_TYPE_REAL32, Command, LeaseAction, MissionType, Mode
from protocol.wire.message import Message
from protocol.wire.messages import LeaseRequest, MissionItemInt, ParamSet, ParamValue
from runtime.errors import LocalError, RemoteError
from runtime.units import NS_PER_MS, NS_PER_S

DIALS: Final = Network(mode="client", connect=("tcp/127.0.0.1:7447",))
STEER_NS: Final = 50 * NS_PER_MS
ORDERS: Final[Mapping[str, tuple[Command, float]]] = {
    "hold": (Command.DO_PAUSE_CONTINUE, 0.0),
    "resume": (Command.DO_PAUSE_CONTINUE, 1.0),
    "abort": (Command.SIDESTEP_ABORT_GOAL, 0.0),
    "rtl": (Command.NAV_RETURN_TO_LAUNCH, 0.0),
    "arm": (Command.COMPONENT_ARM_DISARM, 1.0),
    "disarm": (Command.COMPONENT_ARM_DISARM, 0.0),
    "clear-estop": (Command.SIDESTEP_CLEAR_EMERGENCY_STOP, 0.0),
}
"""The commands of verbs, with their first parameter."""


@dataclass(slots=True)
class OperatorRequest:
    """A request of an operator and its outcome; `answered` is None without an answer in time."""

    operator: str
    action: str
    asked_ns: int
    request: Message | None = None
    content: tuple[Any, ...] = ()
    ended_ns: int | None = None
    answered: bool | None = None
    reason: int = 0
    killed: bool = False
    """The operator's process ended before an answer."""


@dataclass(slots=True)
class RequestHistory:
    """The requests of all operators."""

    open: list[OperatorRequest] = field(default_factory=list)
    """Requests that have not been judged."""
    pressed: list[OperatorRequest] = field(default_factory=list)
    """Emergency stops that have not been judged."""
    by_id: dict[int, OperatorRequest] = field(default_factory=dict)

    def begin(self, asked: OperatorRequest) -> None:
        """Add a request."""
        self.open.append(asked)
        if asked.action == "stop":
            self.pressed.append(asked)
        number = getattr(asked.request, "request_id", 0)
        if number:
            self.by_id[number] = asked

    def ended(self) -> list[OperatorRequest]:
        """Return the requests that ended since the last call, in the order of their sending."""
        ended = [asked for asked in self.open if asked.ended_ns is not None]
        self.open = [asked for asked in self.open if asked.ended_ns is None]
        return ended


class SimulatedOperator:
    """An operator; `start` after `kill` opens another session of the same operator.

    Several may be programs of one `person`.
    """

    def __init__(self, scheduler: Scheduler, name: str, history: RequestHistory) -> None:
        self.name = self.person = name
        self.host = Host(scheduler, name)
        self.host.alive = False
        self.starts = 0
        self.bus: Bus | None = None
        self.beating = False
        self._scheduler = scheduler
        self._history = history
        self._loop: SimulatedLoop | None = None
        self._actions: deque[tuple[str, tuple[Argument, ...]]] = deque()
        self._has_actions: asyncio.Event | None = None
        self._stopping: set[asyncio.Task[None]] = set()

    @property
    def dials(self) -> Network:
        """The network of the process, with its person."""
        return replace(DIALS, person=self.person)

    @property
    def common(self) -> Common:
        """The robot, and the way to it."""
        return Common(network=self.dials, robot="r1")

    def start(self) -> None:
        """Start the process."""
        if self.host.alive:
            return
        self.starts += 1
        offset_ns = (700 + 13 * self.starts + len(self.name)) * 1_000_000_000
        self.host = Host(self._scheduler, self.name, offset_ns)
        self.beating = False
        self._actions.clear()
        self.host.spawn(self._main)

    def kill(self) -> None:
        """Kill the process; the lease is not released."""
        if self.bus is not None and self.host.alive:
            self.host.alive = False
            session: Any = self.bus._session
            session.close()
            self.host.kill()
        for one in self._history.open:
            if one.operator == self.name and one.ended_ns is None:
                one.ended_ns, one.killed = self._scheduler.now_ns, True
        self.bus = self._loop = self._has_actions = None

    def do(self, action: str, arguments: tuple[Argument, ...]) -> None:
        """Run an action: a stop at once, others after the current one."""
        if not self.host.alive:
            return
        call = self._press_stop
        if action != "stop":
            self._actions.append((action, arguments))
            call = self._go_on
        if self._loop is not None:
            self.host.call(self._loop.call_soon_threadsafe, call)

    def _go_on(self) -> None:
        if self._has_actions is not None:
            self._has_actions.set()

    def _main(self) -> None:
        bus = self.bus = open_bus(self.dials, Role.GROUND, "r1", self.host.now_ns)
        bus.announce("r1")
        robot = self._robot = Robot(bus, self.common, clock=SimulatedClock())
        self._loop = SimulatedLoop()
        self._loop.run(self._live(robot))

    async def _live(self, robot: Robot) -> None:
        await asyncio.gather(self._beat(robot), self._act_in_turn(robot))

    async def _act_in_turn(self, robot: Robot) -> None:
        has_actions = self._has_actions = asyncio.Event()
        while True:
            while self._actions:
                action, arguments = self._actions.popleft()
                await ACTIONS[action](self, robot, *arguments)
            has_actions.clear()
            await has_actions.wait()

    async def _beat(self, robot: Robot) -> None:
        publisher = None
        while True:
            if self.beating:
                if publisher is None:
                    heartbeat = publisher = robot.lease.declare_heartbeat()
                    await robot.in_own_thread(partial(robot.bus.await_matched, [heartbeat], 0.5))
                robot.lease.beat()
            await robot.sleep_until(robot.clock.now_ns() + BEAT_NS)

    # Actions; each request is added to the history.

    def _begin(self, action: str, request: Message | None, *content: Any) -> OperatorRequest:
        asked = OperatorRequest(self.name, action, self._scheduler.now_ns, request, content)
        self._history.begin(asked)
        return asked

    def _end(self, asked: OperatorRequest, answered: bool | None, reason: int = 0) -> bool:
        asked.ended_ns = self._scheduler.now_ns
        asked.answered, asked.reason = answered, reason
        return bool(answered)

    async def ask(
        self, robot: Robot, action: str, request: Any, service: Service = COMMAND
    ) -> bool:
        """Send a request; the history has that for the lease without its number."""
        asked = self._begin(action, request if service is COMMAND else None)
        try:
            answer = await robot.ask(request, service=service)
        except (RemoteError, LocalError):
            return self._end(asked, None)
        return self._end(asked, answer.ok, answer.reason if isinstance(answer, Refused) else 0)

    def _press_stop(self) -> None:
        pressing = asyncio.ensure_future(self._stop(self._robot))
        self._stopping.add(pressing)
        pressing.add_done_callback(self._end_stop)

    def _end_stop(self, pressing: "asyncio.Task[None]") -> None:
        self._stopping.discard(pressing)
        if not pressing.cancelled() and (error := pressing.exception()) is not None:
            self.host.error = error  # an invariant judges it

    async def _stop(self, robot: Robot) -> None:
        """Press the emergency stop, and repeat it until it is acknowledged or given up."""
        with robot.subscribed(STATUS) as telemetry:
            stop = EmergencyStop(
                robot.bus,
                robot.bus.publisher(STOP, robot.name),
                robot.name,
                robot.clock,
                lambda: telemetry.latest(STATUS),
            )
            asked = self._begin("stop", None, stop.request_id)
            outcome = await robot.in_own_thread(stop.run)
        self._end(asked, True if outcome.acknowledged else None)

    async def take(self, robot: Robot, how: str) -> bool:
        """Take, seize or release the lease."""
        action = LeaseAction[how]
        request = LeaseRequest(request_id=robot.ids.next(), action=action, name=self.name)
        ok = await self.ask(robot, f"lease {how}", request, LEASE_SERVICE)
        if ok:
            self.beating = action in (LeaseAction.TAKE, LeaseAction.SEIZE)
        return ok

    async def order(self, robot: Robot, verb: str) -> bool:
        """Send the command of a verb."""
        return await self.ask(robot, verb, robot.request(*ORDERS[verb]))

    async def mode(self, robot: Robot, name: str) -> bool:
        """Change the mode."""
        request = robot.request(Command.DO_SET_MODE, 1.0, float(Mode[name]))
        return await self.ask(robot, f"mode {name}", request)

    async def goto(self, robot: Robot, x_m: float, y_m: float, mode: str) -> bool:
        """Send a goal."""
        where = destination([x_m, y_m]).on_the_wire()
        return await self.ask(robot, "goto", goal_request(where, robot.ids.next(), Mode[mode]))

    async def teleop(self, robot: Robot, speed_m_s: float, yaw_rad_s: float, for_s: float) -> bool:
        """Arm, choose MANUAL and steer."""
        if not await self.mode(robot, "MANUAL"):
            return False
        await self.order(robot, "arm")
        stick, clock = TeleopSender(robot.bus, robot.name, robot.clock), robot.clock
        until_ns = clock.now_ns() + round(for_s * NS_PER_S)
        while clock.now_ns() < until_ns:
            stick.drive(speed_m_s, yaw_rad_s)
            await robot.sleep_until(clock.now_ns() + STEER_NS)
        stick.stop()
        return True

    async def drive(self, robot: Robot, x_m: float, y_m: float, mode: str) -> bool:
        """Arm and send a goal."""
        await self.order(robot, "arm")
        return await self.goto(robot, x_m, y_m, mode)

    async def param(self, robot: Robot, name: str, value: float) -> bool:
        """Set a parameter."""
        request = ParamSet(param_id=name, param_value=value, param_type=PARAM_TYPE_REAL32)
        asked = self._begin("param", request, name, value)
        try:
            setting = ParameterExchange(request, robot.clock.now_ns())
            answer = await robot.exchange(setting, PARAMETER)
        except RemoteError:
            return self._end(asked, None)
        if isinstance(answer, ParamValue):
            return self._end(asked, True)
        return self._end(asked, False, getattr(answer, "result_param2", 0))

    async def fence(self, robot: Robot, radius_m: float, corners: int = 0) -> bool:
        """Upload a circle around the start, or a square as wide; clear the fence for 0."""
        if not radius_m:
            return await self._transfer(robot, "fence off", MissionType.FENCE, ())
        x_m, y_m = self.centre
        fence: Circle | Polygon = Circle(x_m=x_m, y_m=y_m, radius_m=radius_m)
        if corners:
            sides = ((-1, -1), (1, -1), (1, 1), (-1, 1))
            fence = Polygon(
                corners=tuple((x_m + right * radius_m, y_m + up * radius_m) for right, up in sides)
            )
        items = tuple(fence_items_of(fence))
        return await self._transfer(robot, "fence", MissionType.FENCE, items)

    async def mission(self, robot: Robot, hold_s: float, *places: float) -> bool:
        """Upload stops and start the mission."""
        stops = zip(places[::2], places[1::2], strict=True)
        waypoints = [Waypoint(x_m=x_m, y_m=y_m, hold_s=hold_s) for x_m, y_m in stops]
        items = tuple(items_of(waypoints))
        if not await self._transfer(robot, "mission", MissionType.MISSION, items):
            return False
        await self.order(robot, "arm")
        return await self.ask(robot, "start", robot.request(Command.MISSION_START, 0.0))

    async def _transfer(
        self, robot: Robot, action: str, kind: MissionType, items: tuple[MissionItemInt, ...]
    ) -> bool:
        now_ns = robot.clock.now_ns()
        asked = self._begin(action, None, kind, items)
        try:
            verdict = await send(
                robot, Upload(items, kind, now_ns) if items else Clear(kind, now_ns)
            )
        except RemoteError:
            return self._end(asked, None)
        return self._end(asked, verdict.ok, verdict.reason)

    centre: tuple[float, float] = (0.0, 0.0)


ACTIONS: Final[dict[str, Callable[..., Coroutine[Any, Any, bool]]]] = {
    "lease": SimulatedOperator.take,
    "order": SimulatedOperator.order,
    "mode": SimulatedOperator.mode,
    "goto": SimulatedOperator.goto,
    "drive": SimulatedOperator.drive,
    "teleop": SimulatedOperator.teleop,
    "param": SimulatedOperator.param,
    "fence": SimulatedOperator.fence,
    "mission": SimulatedOperator.mission,
}


POLL_NS: Final = 50_000_000
ACKNOWLEDGED: Final = "E-STOP acknowledged"
STILL: Final = ("param", "fence")
"""Actions that do not move the robot, for which the station takes no lease."""


class OperatorAction(NamedTuple):
    """An action of an operator, as a command of the station."""

    operator: SimulatedOperator
    action: str
    arguments: tuple[Argument, ...]

    async def perform(self, robot: Robot) -> JobResult:
        """Run it on the station's robot."""
        ok = await ACTIONS[self.action](self.operator, robot, *self.arguments)
        return JobResult(ok, self.action)


class StationOperator(SimulatedOperator):
    """An operator whose answers appear in the station's log."""

    _station: Station | None = None
    _pressed: OperatorRequest | None = None
    _lines_before = 0

    def _main(self) -> None:
        bus = self.bus = open_bus(self.dials, Role.GROUND, "r1", self.host.now_ns)
        clock = SimulatedClock()
        station = self._station = Station(bus, "r1", clock, name=self.name, common=self.common)
        self._pressed = None
        self._loop = SimulatedLoop()
        self._loop.run(self._polling(station))

    async def _polling(self, station: Station) -> None:
        while True:
            if not station.queue.busy and self._actions:
                self._act(station, *self._actions.popleft())
            station.poll()
            self._see_stop(station)
            await asyncio.sleep(POLL_NS / NS_PER_S)

    def _act(self, station: Station, action: str, arguments: tuple[Argument, ...]) -> None:
        if action == "lease":
            station.queue.lease(LeaseAction[str(arguments[0])])
            return
        station.queue.submit(
            action, OperatorAction(self, action, arguments), moves=action not in STILL
        )

    def _press_stop(self) -> None:
        """Press the station's emergency stop, which repeats until acknowledged or given up."""
        station = self._station
        if station is None:
            return
        station.estop()
        if self._pressed is None:
            self._lines_before = station.log.total
            self._pressed = self._begin("stop", None)

    def _see_stop(self, station: Station) -> None:
        press = self._pressed
        if press is None or station.stopping:
            return
        self._pressed = None
        acknowledged = any(
            ACKNOWLEDGED in line.text for line in station.log.since(self._lines_before)
        )
        self._end(press, True if acknowledged else None)
