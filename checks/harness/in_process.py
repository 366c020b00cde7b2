"""A whole stack in one process, as Zenoh peers on loopback, in simulated time.

Plant, robot and operator can be started and killed separately. Frames travel over real sockets. A
control period of simulated time passes when all frames of a tick have arrived. Nothing sleeps:
waiting for a frame is a condition with a deadline.
"""

import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from dataclasses import replace
from math import degrees, hypot, inf, radians, remainder
from typing import Final, Self
from uuid import uuid4

from checks.harness.observer import is_still
from checks.harness.processes import OPERATOR_BEAT, await_subscribers, command_request
from plant.model.configuration import Fault, noise_of
from plant.process import Process as PlantProcess
from plant.process import RequestQueue, Wake
from plant.robot_link import PlantLink
from plant.sim.simulation import Plant
from plant.world.file import load
from protocol.bus.bus import Bus, open_bus
from protocol.bus.network import Mode as NetworkMode
from protocol.bus.network import Network
from protocol.outcome import wire_goal
from protocol.topics import (
    COMMAND,
    CYCLE,
    DRIVE,
    OPERATOR,
    RUN,
    SONAR,
    STATUS,
    TELEOP,
    TEXT,
    TOPICS,
    WHEELS,
    WORLD,
    Role,
    Service,
    Topic,
)
from protocol.wire.codec import decode
from protocol.wire.enums import Command, GoalState, Mode, Navigator, Vehicle
from protocol.wire.message import Message
from protocol.wire.messages import CommandAck, GoalRequest, GroundTruth, NavigatorStatus, Statustext
from protocol.wire.reasons import Reason
from protocol.world import World
from robot.core.parameters import DEFAULTS
from robot.core.values import Pose
from robot.hosting import InProcessCore, NewCore
from robot.parameter_table import with_value
from robot.process import CycleMeter, RobotProcess
from robot.senses import Senses
from robot.storage import Store
from robot.vehicle import RobotVehicle
from runtime.clock import ManualClock, Tick
from runtime.config import start_totals
from runtime.units import NS_PER_MS, NS_PER_S, PERIOD_NS

FRAME_S: Final = 30.0
"""Limit for a match or an answer; a robot refuses requests that stay valid for over a minute."""
LEASE_MS: Final = 60_000
"""A busy computer may not run the threads of a bus for seconds: no link ends while a test waits."""
PATIENCE_S: Final = 60.0
"""Time for a frame to arrive on a busy computer."""
REPORTED: Final = "cycle report at the ground"
MAILBOXES: Final = (SONAR, WHEELS, OPERATOR, TELEOP)
"""Topics that the robot reads; it subscribes to the others only to count their arrivals."""


class Arrivals:
    """Counts the samples that arrive on a bus and waits for them with a deadline."""

    def __init__(self) -> None:
        self._changed = threading.Condition()
        self._counts: dict[str, int] = {}

    def record(self, key: str) -> None:
        """Count a sample."""
        with self._changed:
            self._counts[key] = self._counts.get(key, 0) + 1
            self._changed.notify_all()

    def count(self, key: str) -> int:
        """Return how many samples of a key have arrived."""
        return self._counts.get(key, 0)

    def wait(self, condition: Callable[[], bool], what: str) -> None:
        """Wait for a condition on the counts; RuntimeError when it does not hold in time."""
        with self._changed:
            if not self._changed.wait_for(condition, PATIENCE_S):
                raise RuntimeError(f"{what} did not arrive")


class Peers:
    """The processes of a stack and their buses.

    With `operator`, the operator's heartbeat is sent. With `enforced`, a robot that loses
    time is held to its budget, in simulated time.
    """

    def __init__(
        self,
        world: str | World = "open",
        *,
        navigator: str = "vgm_memory",
        noise: str = "none",
        seed: int = 0,
        router: bool = False,
        parameters: dict[str, float] | None = None,
        enforced: bool = False,
        new_core: NewCore = InProcessCore,
    ) -> None:
        self.world = load(world) if isinstance(world, str) else world
        self.operator = self._listening = False
        self.texts: list[str] = []
        self.clock = ManualClock()
        self._params = DEFAULTS._replace(navigator=Navigator[navigator.upper()])
        for name, value in (parameters or {}).items():
            self._params = with_value(self._params, name, value)
        self._noise = noise_of(self.world, noise)
        self._seed = seed
        self._enforced = enforced
        self._new_core = new_core
        self._router = router
        self._prefix = f"test-{uuid4().hex[:8]}"
        self._arrivals = Arrivals()
        self._scopes = {name: ExitStack() for name in ("router", "robot", "plant", "ground")}
        self._hub = "tcp/127.0.0.1:0"
        self._ticks = 0
        self._commands = 0
        self.buses: dict[str, Bus] = {}
        self.robot: RobotProcess | None = None
        self.plant: PlantProcess | None = None

    def start(self, name: str) -> None:
        """Start the robot, the plant or the ground."""
        {"robot": self._start_robot, "plant": self._start_plant, "ground": self._start_ground}[
            name
        ]()

    def kill(self, name: str) -> None:
        """Remove a process from the bus without notice, as SIGKILL does."""
        self._scopes[name].close()
        if name == "robot":
            self.robot = None
        elif name == "plant":
            self.plant = None
        else:
            self.operator = self._listening = False

    def _start_robot(self) -> None:
        bus = self._open("robot", Role.ROBOT)
        start = self.world.start
        self.vehicle = RobotVehicle(
            self._params,
            Store(None),
            Pose(start.x_m, start.y_m, start.heading_rad),
            totals=start_totals(self.world.robot),
            new_core=self._new_core,
        )
        senses = self._senses = Senses(bus, lockstep=True, accept=self.vehicle.lease.allows)
        meter = CycleMeter(self.clock, period_ns=PERIOD_NS, enforced=self._enforced)
        self.robot = RobotProcess(self.vehicle, bus, self.clock, senses, meter)
        self.robot.serve()
        bus.announce()
        for topic in TOPICS:
            if topic not in MAILBOXES:
                bus.stream(topic, ignore)
        bus.faults.after = self._arrivals.record

    def _start_plant(self) -> None:
        bus = self._open("plant", Role.PLANT)
        plant = Plant(self.world, self._seed, self._noise, at_ns=self.clock.now_ns())
        requests = RequestQueue(running=True, world={}, nudge=lambda: None)
        link = PlantLink(bus, "r1", 0, ignore, lockstep=True)
        bus.faults.after = lambda key: self._arrivals.record(f"{key} at the plant")
        for service in (RUN, WORLD):
            bus.serve(service, lambda request: requests.ask(0, request))
        bus.announce()
        self.plant = PlantProcess(plant, [link], requests, Wake())
        await_subscribers(bus, link.publishers[-1:], FRAME_S)

    def _start_ground(self) -> None:
        self.ground = self._open("ground", Role.GROUND)
        self._status = self.ground.mailbox(STATUS)
        self._report = self.ground.mailbox(CYCLE)
        self.ground.faults.after = self._count_report
        self.ground.stream(TEXT, self._keep_text)
        self._beat = self.ground.publisher(OPERATOR)
        self.operator = self._listening = True
        self.reconnect()

    @property
    def client_network(self) -> Network:
        """The network settings of a client of this stack."""
        return Network(mode="client", connect=(self._hub,), prefix=self._prefix)

    def join(self, role: Role, person: str = "") -> Bus:
        """Open one more bus in this role, for a person of this name."""
        return self._open("ground", role, person)

    def _open(self, name: str, role: Role | None, person: str = "") -> Bus:
        """Open a bus: the hub (the router, or the robot without one) listens, others connect."""
        hub = "router" if self._router else "robot"
        if name == hub:
            mode: NetworkMode = "router" if self._router else "peer"
            network = Network(mode=mode, listen=(self._hub,), prefix=self._prefix)
        else:
            network = self.client_network
        network = replace(network, lease_ms=LEASE_MS, person=person)
        bus = self._scopes[name].enter_context(open_bus(network, role, "r1", self.clock.now_ns))
        bus.faults.by_hand = True
        self.buses[name] = bus
        if name == hub:
            self._hub = bus.locator()
        return bus

    def reconnect(self) -> None:
        """Wait until plant and operator have found a robot that was started again."""
        if self.plant is None or self.robot is None:
            raise RuntimeError("start robot and plant before the ground connects to them")
        publishers = [self.plant.links[0].publishers[-1], self._beat, self.robot.reports.cycle]
        await_subscribers(self.ground, publishers, FRAME_S)

    def start_all(self) -> None:
        """Start all processes."""
        if self._router:
            self._open("router", None)
        for name in ("robot", "plant", "ground"):
            self.start(name)

    def close_all(self) -> None:
        """Close all buses."""
        for name in ("ground", "plant", "robot", "router"):
            self._scopes[name].close()

    def _count_report(self, key: str) -> None:
        """Count a cycle report, which ends a tick, as soon as its mailbox has it."""
        if key.endswith(CYCLE.path):
            self._arrivals.record(REPORTED)

    def _keep_text(self, _key: str, frame: bytes, _arrived_ns: int) -> None:
        text = decode(frame).message
        if isinstance(text, Statustext):
            self.texts.append(text.text)


def ignore(*_: object) -> None:
    """Ignore a sample."""


BEAT_TICKS: Final = 4
TOLERANCES: Final = (0.05, 0.05236)
"""Of a goal's position in m and of its heading in rad."""


class InProcess(Peers):
    """A stack that a test advances tick by tick.

    `hanging` names the processes that are suspended: they do nothing, and their links stay open.
    """

    hanging: frozenset[str] = frozenset()

    def __enter__(self) -> Self:
        self.start_all()
        self.forward(0.05)
        return self

    def __exit__(self, *_: object) -> None:
        self.close_all()

    # Time: each control period has three phases.

    def forward(self, seconds: float) -> None:
        """Advance simulated time by this many seconds."""
        for _ in range(round(seconds * 20)):
            self.cycle()

    def until(self, condition: Callable[[], bool], within_s: float = 120.0) -> float:
        """Advance until the condition holds; AssertionError after `within_s`. Return seconds."""
        started_ns = self.clock.now_ns()
        while not condition():
            elapsed_s = (self.clock.now_ns() - started_ns) / NS_PER_S
            assert elapsed_s < within_s, f"not within {within_s} s: {self.describe()}"
            self.cycle()
        return (self.clock.now_ns() - started_ns) / NS_PER_S

    def cycle(self) -> None:
        """Advance one control period."""
        for phase in self.phases:
            phase()

    @property
    def phases(self) -> tuple[Callable[[], None], ...]:
        """The phases of a period: publish senses, run the robot, advance the plant."""
        return self._sense, self._think, self._act

    def _sense(self) -> None:
        if self.operator and self._ticks % BEAT_TICKS == 0:
            self._send(self._beat.key, lambda: self._beat.put(OPERATOR_BEAT), self.robot)
        if self.plant is not None and "plant" not in self.hanging:
            wires = self.plant.links[0]
            self._send(wires.publishers[-1].key, self.plant.publish, self.robot)

    def _think(self) -> None:
        if self.robot is None or "robot" in self.hanging:
            return
        self.buses["robot"].faults.release(self.clock.now_ns())
        plant, ground = self.key_at_plant, REPORTED
        before = self._arrivals.count(plant), self._arrivals.count(ground)
        self.robot.cycle(Tick(self._ticks, self.clock.now_ns(), 0, 0))
        if self._listening:
            self._arrivals.wait(lambda: self._arrivals.count(ground) > before[1], CYCLE.path)
        if self.plant is not None:
            self._arrivals.wait(lambda: self._arrivals.count(plant) > before[0], DRIVE.path)

    @property
    def key_at_plant(self) -> str:
        """The key that counts wheel commands which arrived at the plant."""
        return f"{self.buses['robot'].key(DRIVE.path)} at the plant"

    def _act(self) -> None:
        if self.plant is not None and "plant" not in self.hanging:
            self.buses["plant"].faults.release(self.clock.now_ns())
            self.plant.advance()
        self._ticks += 1
        self.clock.advance(PERIOD_NS)

    def _send(self, key: str, put: Callable[[], object], receiver: object) -> None:
        """Publish a sample and wait until `receiver`, if any, has it."""
        seen = self._arrivals.count(key)
        put()
        if receiver is not None:
            self._arrivals.wait(lambda: self._arrivals.count(key) > seen, key)

    def send(self, key: str, put: Callable[[], object]) -> None:
        """Publish a sample and wait until the robot has it."""
        self._send(key, put, self.robot)

    # The operator: requests and observations.

    def ask(
        self, request: Message, service: Service = COMMAND, asker: Bus | None = None
    ) -> Message:
        """Send a request while the robot's loop runs, and return its answer."""
        with ThreadPoolExecutor(1) as pool:
            answer = pool.submit((asker or self.ground).ask, service, request, FRAME_S)
            while not answer.done():
                if self.robot is not None:
                    self.robot.idle()
            found = answer.result()
        assert not isinstance(found, bytes)
        return found

    def command(self, command: Command, param1: float = 0.0, param2: float = 0.0) -> Reason:
        """Send a command and return the reason in its answer; `Reason.NONE` if accepted."""
        self._commands += 1
        newest = self._status.latest()
        stop_id = 0 if newest is None else newest[0].stop_id
        request = command_request(self._commands, command, param1, param2, stop_id)
        return reason_in(self.ask(request))

    def arm(self) -> Reason:
        """Arm the robot."""
        return self.command(Command.COMPONENT_ARM_DISARM, 1)

    def goto(
        self, x_m: float, y_m: float, deg: float | None = None, mode: Mode = Mode.GUIDED
    ) -> Reason:
        """Send a goal, with any heading if `deg` is None."""
        self._commands += 1
        heading_rad = None if deg is None else radians(deg)
        goal = wire_goal(x_m, y_m, heading_rad, *TOLERANCES)._asdict()
        return reason_in(self.ask(GoalRequest(request_id=self._commands, mode=mode, **goal)))

    def goto_goal(self, mode: Mode = Mode.GUIDED) -> Reason:
        """Send the goal of the world."""
        goal = self.world.goal
        heading_rad = goal.heading_rad
        return self.goto(
            goal.x_m, goal.y_m, None if heading_rad is None else degrees(heading_rad), mode
        )

    @property
    def status(self) -> NavigatorStatus:
        """The newest status that the operator has received."""
        newest = self._status.latest()
        assert newest is not None, "no status has arrived"
        return newest[0]

    @property
    def truth(self) -> GroundTruth:
        """The true state of the robot."""
        assert self.plant is not None
        return self.plant.plant.truth()

    @property
    def senses_used(self) -> tuple[int, int]:
        """The sequence numbers of the wheel ticks and the scan that the robot used last."""
        return self._senses.wheels_seq, self._senses.scan_seq

    @property
    def goal_state(self) -> GoalState:
        """The state of the goal."""
        return GoalState(self.vehicle.state.machine.goal_state)

    @property
    def state(self) -> Vehicle:
        """The state of the vehicle."""
        return Vehicle(self.vehicle.state.machine.vehicle)

    @property
    def why(self) -> Reason:
        """The reason for the state of the vehicle."""
        return Reason(self.vehicle.state.machine.vehicle_reason)

    def reached(self) -> bool:
        """Return whether the goal is reached."""
        return self.goal_state == GoalState.REACHED

    def standing(self) -> bool:
        """Return whether the robot is truly at rest."""
        return is_still(self.truth)

    def driving(self) -> bool:
        """Return whether the robot truly moves faster than 0.2 m/s."""
        return self.truth.speed_m_s > 0.2

    def describe(self) -> str:
        """Return position, vehicle state and goal state for error messages."""
        machine = self.vehicle.state.machine
        where = f"at {self.truth.x_m:.2f}, {self.truth.y_m:.2f}; " if self.plant else ""
        return f"{where}{self.state.name} ({self.why.name}), goal {self.goal_state.name}" + (
            f" ({Reason(machine.goal_reason).name})"
        )

    def assert_near(
        self, x_m: float, y_m: float, deg: float | None = None, *, within_m: float = 0.08
    ) -> None:
        """Require the true pose to be near; the estimated one may differ."""
        truth = self.truth
        off_m = hypot(truth.x_m - x_m, truth.y_m - y_m)
        assert off_m <= within_m, f"{off_m:.3f} m away from ({x_m}, {y_m}): {self.describe()}"
        if deg is not None:
            off_deg = abs(degrees(remainder(truth.heading_rad - radians(deg), radians(360))))
            assert off_deg <= 5.0, f"{off_deg:.1f} deg off {deg}: {self.describe()}"

    def rejected_shown(self) -> int:
        """Unreadable frames, as the robot's cycle report counts them."""
        newest = self._report.latest()
        assert newest is not None, "no cycle report has arrived"
        return newest[0].rejected

    def digest(self) -> str:
        """SHA-256 over the true trajectory up to the end of the goal."""
        assert self.plant is not None
        ended_ns = self.vehicle.state.machine.goal_ended_ms * NS_PER_MS
        return bytes(self.plant.plant.score(ended_ns).digest).hex()

    def send_raw(self, topic: Topic[Message], frame: bytes) -> None:
        """Put bytes on a topic as a stranger would, and wait until the robot's side has them."""
        publisher = self.ground.publisher(topic)
        assert self.ground.await_matched([publisher], FRAME_S) == []
        self._send(publisher.key, lambda: publisher.put_frame(frame), self.robot)

    # Faults, by the names of [[fault]] in a world file.

    def inject(self, kind: str, target: str = "", value: float = 0.0, for_s: float = inf) -> None:
        """Inject a fault into the plant now, for so many seconds."""
        assert self.plant is not None
        now_s = self.plant.plant.now_ns / NS_PER_S
        self.plant.plant.inject(Fault(kind, target, now_s, now_s + for_s, value))

    def clear_faults(self) -> None:
        """Remove all faults of the plant."""
        assert self.plant is not None
        self.plant.plant.clear_faults()


def reason_in(answer: Message) -> Reason:
    """Return the reason in a command acknowledgement."""
    assert isinstance(answer, CommandAck)
    return Reason(answer.result_param2)
