"""Operators of the simulation: at the command line's own client code, or at the ground station.

At the command line an operator is a process with two threads of work: one runs its actions in turn,
the other its emergency stops, which do not wait. Its heartbeat has a thread of its own, as in
`lease take`. The ground station is its model without the screen, polled 20 times a second; lease,
heartbeat, emergency stop and requests are its own.
"""

import asyncio
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Final, NamedTuple

from checks.simulation.hosts.virtual_time import (
    Argument,
    Host,
    Scheduler,
    SimulatedClock,
    SimulatedLoop,
    SimulatedQueue,
)
from ground.client.connection import Common
from ground.client.emergency_stop import EmergencyStop
from ground.client.goal import destination, goal_request
from ground.client.link import Link, ask_lease
from ground.client.outcomes import Answer, Refused
from ground.client.requests import BEAT_NS, is_saving
from ground.client.teleop_sender import TeleopSender
from ground.missions.mission import Circle, Polygon, Waypoint
from ground.missions.transfer import Clear, Upload, Verdict, fence_items_of, items_of
from ground.robot import Robot
from ground.station.robot.background_requests import JobResult
from ground.station.station import Station
from protocol.bus.bus import open_bus
from protocol.bus.network import Network
from protocol.topics import MISSION_SERVICE, PARAMETER, STATUS, STOP, Role
from protocol.wire.enums import PARAM_TYPE_REAL32, Command, LeaseAction, MissionType, Mode
from protocol.wire.message import Message
from protocol.wire.messages import MissionItemInt, ParamSet, ParamValue
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
        self.link: Link | None = None
        self.beating = False
        self.closed = False
        self._scheduler = scheduler
        self._history = history
        self._actions: SimulatedQueue[tuple[str, tuple[Argument, ...]]] | None = None
        self._early: deque[tuple[str, tuple[Argument, ...]]] = deque()

    @property
    def dials(self) -> Network:
        """The network of the process, with its person."""
        return replace(DIALS, person=self.person)

    def start(self) -> None:
        """Start the process."""
        if self.host.alive:
            return
        self.starts += 1
        offset_ns = (700 + 13 * self.starts + len(self.name)) * 1_000_000_000
        self.host = Host(self._scheduler, self.name, offset_ns)
        self.beating = False
        self._early.clear()
        self.host.spawn(self._main)

    def kill(self) -> None:
        """Kill the process; the lease is not released."""
        if self.link is not None and self.host.alive:
            self.host.alive = False
            session: Any = self.link.bus._session
            session.close()
            self.host.kill()
        for one in self._history.open:
            if one.operator == self.name and one.ended_ns is None:
                one.ended_ns, one.killed = self._scheduler.now_ns, True
        self.link = self._actions = None

    def do(self, action: str, arguments: tuple[Argument, ...]) -> None:
        """Run an action: a stop at once, others after the current one."""
        if not self.host.alive:
            return
        if action == "stop":
            self.host.spawn(self._stop)
        elif self._actions is None:
            self._early.append((action, arguments))
        else:
            self._actions.put((action, arguments))

    def _main(self) -> None:
        bus = open_bus(self.dials, Role.GROUND, "r1", self.host.now_ns)
        link = Link(bus, Common(network=self.dials, robot="r1"), SimulatedClock())
        actions = self._actions = SimulatedQueue()
        bus.announce("r1")
        self.link = link
        self.host.spawn(self._beat)
        while self._early:
            actions.put(self._early.popleft())
        while True:
            action, arguments = actions.get()
            ACTIONS[action](self, link, *arguments)

    def _beat(self) -> None:
        link = self._linked()
        while True:
            if self.beating:
                link.beat()
            link.clock.sleep_until(link.clock.now_ns() + BEAT_NS)

    def _linked(self) -> Link:
        assert self.link is not None
        return self.link

    # Actions; each request is added to the history.

    def _begin(self, action: str, request: Message | None, *content: Any) -> OperatorRequest:
        asked = OperatorRequest(self.name, action, self._scheduler.now_ns, request, content)
        self._history.begin(asked)
        return asked

    def _end(self, asked: OperatorRequest, answered: bool | None, reason: int = 0) -> bool:
        asked.ended_ns = self._scheduler.now_ns
        asked.answered, asked.reason = answered, reason
        return bool(answered)

    def _ask(self, action: str, request: Any, ask: Callable[[], Answer]) -> bool:
        asked = self._begin(action, request)
        try:
            answer = ask()
        except (RemoteError, LocalError):
            return self._end(asked, None)
        return self._end(asked, answer.ok, answer.reason if isinstance(answer, Refused) else 0)

    def command(self, link: Link, action: str, request: Any) -> bool:
        """Send a command."""
        return self._ask(action, request, lambda: link.ask(request))

    def _stop(self) -> None:
        """Press the station's emergency stop."""
        link = self._linked()
        with link.subscribed(STATUS) as telemetry:
            publisher = link.bus.publisher(STOP, link.robot)
            stop = EmergencyStop(
                link.bus, publisher, link.robot, link.clock, lambda: telemetry.latest(STATUS)
            )
            asked = self._begin("stop", None, stop.request_id)
            outcome = stop.run()
        self._end(asked, True if outcome.acknowledged else None)

    def take(self, link: Link, how: str) -> bool:
        """Take, seize or release the lease."""
        action = LeaseAction[how]

        def ask() -> Answer:
            return ask_lease(link, action, self.name)

        ok = self._ask(f"lease {how}", None, ask)
        if ok:
            self.beating = action in (LeaseAction.TAKE, LeaseAction.SEIZE)
        return ok

    def order(self, link: Link, verb: str) -> bool:
        """Send the command of a verb."""
        return self.command(link, verb, link.command(*ORDERS[verb]))

    def mode(self, link: Link, name: str) -> bool:
        """Change the mode."""
        mode = float(Mode[name])
        return self.command(link, f"mode {name}", link.command(Command.DO_SET_MODE, 1.0, mode))

    def goto(self, link: Link, x_m: float, y_m: float, mode: str) -> bool:
        """Send a goal."""
        where = destination([x_m, y_m]).on_the_wire()
        return self.command(link, "goto", goal_request(where, link.ids.next(), Mode[mode]))

    def teleop(self, link: Link, speed_m_s: float, yaw_rad_s: float, for_s: float) -> bool:
        """Arm, choose MANUAL and steer."""
        if not self.mode(link, "MANUAL"):
            return False
        self.order(link, "arm")
        stick = TeleopSender(link.bus, link.robot, link.clock)
        until_ns = link.clock.now_ns() + round(for_s * NS_PER_S)
        while link.clock.now_ns() < until_ns:
            stick.drive(speed_m_s, yaw_rad_s)
            link.clock.sleep_until(link.clock.now_ns() + STEER_NS)
        stick.stop()
        return True

    def drive(self, link: Link, x_m: float, y_m: float, mode: str) -> bool:
        """Arm and send a goal."""
        self.order(link, "arm")
        return self.goto(link, x_m, y_m, mode)

    def param(self, link: Link, name: str, value: float) -> bool:
        """Set a parameter."""
        request = ParamSet(param_id=name, param_value=value, param_type=PARAM_TYPE_REAL32)
        asked = self._begin("param", request, name, value)
        answer: object = None
        left = 3
        while left and (answer is None or is_saving(answer)):
            try:
                answer = link.bus.ask(PARAMETER, request, 0.5, robot=link.robot)
            except RemoteError:
                answer, left = None, left - 1
        if answer is None:
            return self._end(asked, None)
        if isinstance(answer, ParamValue):
            return self._end(asked, True)
        return self._end(asked, False, getattr(answer, "result_param2", 0))

    def fence(self, link: Link, radius_m: float, corners: int = 0) -> bool:
        """Upload a circle around the start, or a square as wide; clear the fence for 0."""
        if not radius_m:
            return self._transfer(link, "fence off", MissionType.FENCE, ())
        x_m, y_m = self.centre
        fence: Circle | Polygon = Circle(x_m=x_m, y_m=y_m, radius_m=radius_m)
        if corners:
            sides = ((-1, -1), (1, -1), (1, 1), (-1, 1))
            fence = Polygon(
                corners=tuple((x_m + right * radius_m, y_m + up * radius_m) for right, up in sides)
            )
        items = tuple(fence_items_of(fence))
        return self._transfer(link, "fence", MissionType.FENCE, items)

    def mission(self, link: Link, hold_s: float, *places: float) -> bool:
        """Upload stops and start the mission."""
        stops = zip(places[::2], places[1::2], strict=True)
        waypoints = [Waypoint(x_m=x_m, y_m=y_m, hold_s=hold_s) for x_m, y_m in stops]
        items = tuple(items_of(waypoints))
        if not self._transfer(link, "mission", MissionType.MISSION, items):
            return False
        self.order(link, "arm")
        return self.command(link, "start", link.command(Command.MISSION_START, 0.0))

    def _transfer(
        self, link: Link, action: str, kind: MissionType, items: tuple[MissionItemInt, ...]
    ) -> bool:
        now_ns = link.clock.now_ns()
        talk = Upload(items, kind, now_ns) if items else Clear(kind, now_ns)
        asked = self._begin(action, None, kind, items)
        link.exchange(talk, MISSION_SERVICE)
        outcome = talk.outcome
        if isinstance(outcome, Verdict):
            return self._end(asked, outcome.ok, outcome.reason)
        return self._end(asked, None)

    centre: tuple[float, float] = (0.0, 0.0)


ACTIONS: Final[dict[str, Callable[..., bool]]] = {
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


class Action(NamedTuple):
    """An action of an operator, as a command of the station."""

    operator: SimulatedOperator
    action: str
    arguments: tuple[Argument, ...]

    async def perform(self, robot: Robot) -> JobResult:
        """Run it in a thread of its own."""
        link, act = self.operator.link, ACTIONS[self.action]
        ok = await robot.in_own_thread(lambda: act(self.operator, link, *self.arguments))
        return JobResult(ok, self.action)


class StationOperator(SimulatedOperator):
    """An operator whose answers appear in the station's log."""

    _station: Station | None = None
    _press: OperatorRequest | None = None
    _lines_before = 0

    def _main(self) -> None:
        bus = open_bus(self.dials, Role.GROUND, "r1", self.host.now_ns)
        common, clock = Common(network=self.dials, robot="r1"), SimulatedClock()
        self._actions = SimulatedQueue()
        station = self._station = Station(bus, "r1", clock, name=self.name, common=common)
        self._press = None
        self.link = Link(bus, common, clock)
        while self._early:
            self._actions.put(self._early.popleft())
        SimulatedLoop().run(self._polling(station, self._actions))

    async def _polling(
        self, station: Station, actions: SimulatedQueue[tuple[str, tuple[Argument, ...]]]
    ) -> None:
        while True:
            if not station.busy and actions.qsize():
                self._act(station, *actions.get_nowait())
            station.poll()
            self._see_stop(station)
            await asyncio.sleep(POLL_NS / NS_PER_S)

    def _act(self, station: Station, action: str, arguments: tuple[Argument, ...]) -> None:
        if action == "lease":
            if arguments[0] == "RELEASE":
                station.release_lease()
            else:
                station.take_lease(seize=arguments[0] == "SEIZE")
            return

        station.submit(action, Action(self, action, arguments), moves=action not in STILL)

    def _stop(self) -> None:
        """Press the station's emergency stop, which repeats until acknowledged or given up."""
        station = self._station
        if station is None:
            return
        station.estop()
        if self._press is None:
            self._lines_before = station.log.total
            self._press = self._begin("stop", None)

    def _see_stop(self, station: Station) -> None:
        press = self._press
        if press is None or station.stopping:
            return
        self._press = None
        acknowledged = any(
            ACKNOWLEDGED in line.text for line in station.log.since(self._lines_before)
        )
        self._end(press, True if acknowledged else None)
