"""Plant, robot and operator as Zenoh peers in this process, each started and killed separately."""

import threading
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import replace
from typing import Final
from uuid import uuid4

from checks.harness.bus_calls import await_subscribers
from plant.model.configuration import noise_of
from plant.process.loop import Process as PlantProcess
from plant.process.loop import RequestQueue, Wake
from plant.process.robot_link import RobotLink
from plant.sim.simulation import Plant
from plant.world.file import load
from protocol.bus.bus import Bus, open_bus
from protocol.bus.network import Mode as NetworkMode
from protocol.bus.network import Network
from protocol.topics import (
    CYCLE,
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
)
from protocol.wire.codec import decode
from protocol.wire.enums import Navigator
from protocol.wire.messages import Statustext
from protocol.world import World
from robot.core.parameters import DEFAULTS
from robot.core.values import Pose
from robot.hosting import InProcessCore, NewCore
from robot.parameter_table import with_value
from robot.process import CycleMeter, RobotProcess
from robot.senses import Senses
from robot.storage import Store
from robot.vehicle import Vehicle
from runtime.clock import ManualClock
from runtime.config import start_totals
from runtime.units import PERIOD_NS

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
        self.vehicle = Vehicle(
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
        link = RobotLink(bus, "r1", 0, ignore, lockstep=True)
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
