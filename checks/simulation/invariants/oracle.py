"""Check the invariants at every tick against the true state.

`Oracle` receives every tick of plant and robot, every answered request and every published frame,
and passes them to the invariants. The first violation ends a run.
"""

from hashlib import blake2b
from struct import pack
from typing import Any

from checks.simulation.hosts.mavlink import GATEWAY
from checks.simulation.hosts.operators import RequestHistory
from checks.simulation.hosts.robot_and_plant import RobotSide
from checks.simulation.hosts.virtual_time import Host, Scheduler
from checks.simulation.invariants.commanding import (
    ClientInvariants,
    CommandingInvariants,
    RequestInvariants,
)
from checks.simulation.invariants.limits import RunState
from checks.simulation.invariants.persistence import PersistenceInvariants, StopInvariants
from checks.simulation.invariants.robot_loop import LoopInvariants, WheelInvariants
from plant.sim.simulation import Plant
from protocol.topics import STATUS
from protocol.wire.enums import Mode, Vehicle
from protocol.wire.message import Message
from protocol.wire.reasons import Reason
from robot.core import states
from robot.core.modes import Machine
from robot.vehicle import Answer, RobotVehicle
from runtime.clock import Tick

FORGED_NS = 1_000_000_000
"""After forged senses the robot may tick at other times for this long."""


class Oracle:
    """Passes observations to the invariants; `facts` holds violation and coverage."""

    def __init__(self, scheduler: Scheduler, history: RequestHistory) -> None:
        self.facts = RunState(scheduler, history)
        self.presence = CommandingInvariants(self.facts)
        self.motion = WheelInvariants(self.facts, self.presence)
        self.requests = RequestInvariants(self.facts, self.presence)
        self.keeping = PersistenceInvariants(self.facts)
        self.onboard = LoopInvariants(self.facts, self.requests)
        self.stops = StopInvariants(self.facts)
        self.clients = ClientInvariants(self.facts)
        self.digest = blake2b(digest_size=16)
        self._reached: set[str] = set()

    # Events of the network.

    def put(self, source: Host, path: str, frame: bytes) -> None:
        """Record a frame that leaves a host."""
        if source.name == GATEWAY:
            self.clients.put(path, frame)
        if source.name == "robot" and path == STATUS.path:
            self.stops.shown(frame)
        if path == "drive/wheels":
            if source.name == "robot":
                self.motion.command(frame)
            else:
                self.motion.forged(frame)
        elif path.startswith("sense/") and source.name != "plant":
            self.motion.place_known = False
            self.facts.held_up(self.facts.now_ns + FORGED_NS)

    # Events of the plant.

    def plant_started(self) -> None:
        """Record the start of the plant."""
        self.motion.plant_started()

    def plant_tick(self, plant: Plant) -> None:
        """Check after each period of the plant."""
        facts, truth = self.facts, plant.truth()
        facts.plant_ns = plant.now_ns
        fastest_m_s = self.motion.ticked(plant)
        self.onboard.moved(truth.x_m, truth.y_m, truth.heading_rad)
        machine = facts.robot.vehicle.state.machine if facts.robot and facts.robot.vehicle else None
        seen = (0, 0, 0) if machine is None else (machine.vehicle, machine.mode, machine.goal_state)
        self.digest.update(
            pack("<4d3q", truth.x_m, truth.y_m, truth.heading_rad, fastest_m_s, *seen)
            + pack("<2q", facts.now_ns, facts.events)
        )

    # Events of the robot.

    def held_up(self, until_ns: int) -> None:
        """Record that a process is delayed."""
        self.facts.held_up(until_ns)

    def robot_started(self) -> None:
        """Record the start of a robot process, whose only memory is its disk."""
        self.facts.armed_ns = self.facts.started_ns = self.facts.now_ns
        self.facts.is_placed = False
        self.motion.robot_started()
        self.onboard.robot_started()
        self.presence.robot_started()
        self.stops.robot_started()

    def restored(self, vehicle: RobotVehicle) -> None:
        """Check the state that a robot has restored."""
        self.keeping.restored(vehicle)
        self.stops.restored(vehicle)

    def received(
        self, vehicle: RobotVehicle, request: Message, answer: Answer, operator: str
    ) -> None:
        """Record a request that the robot has answered."""
        self.requests.received(vehicle, request, answer, operator)
        self.keeping.received(vehicle, request)
        self.stops.received(vehicle, request, answer, operator)
        self.clients.received(request, answer, operator)

    def cycled(self, side: RobotSide, tick: Tick) -> None:
        """Check after each tick of the robot."""
        vehicle, process = side.vehicle, side.process
        if vehicle is None or process is None:
            return
        self.facts.coverage.robot_ticks += 1
        self._reach(vehicle.state.machine)
        self.onboard.cycled(vehicle, process)
        self.presence.cycled(vehicle)
        self.keeping.cycled(vehicle)
        self.stops.cycled(vehicle)
        self.clients.cycled(vehicle)

    def _reach(self, machine: Machine) -> None:
        """Count each vehicle state and each failsafe once per run."""
        state = Vehicle(machine.vehicle).name
        if machine.vehicle == states.FAILSAFE:
            state = f"{state} {Reason(machine.vehicle_reason).name}"
        elif machine.vehicle == states.ACTIVE:
            state = f"{state} {Mode(machine.mode).name}"
        if state not in self._reached:
            self._reached.add(state)
            self.facts.coverage.reached[state] += 1

    # Ends of processes and requests.

    def judge_ended(self, hosts: list[Host]) -> None:
        """Check the requests and processes that ended since the last call."""
        for asked in self.facts.history.ended():
            self.requests.ended(asked)
            self.keeping.ended(asked)
            self.stops.ended(asked)
        self.stops.judge()
        for host in hosts:
            if host.error is not None:
                error: Any = host.error
                words = f"{host.name}: {type(error).__name__}: {error}"
                self.facts.fail("no process ends by itself", words)
