"""What must hold at every tick, checked against the truth: the oracle of the simulation.

`Oracle` is told of every tick of plant and robot, of every request that the robot has answered and
of every frame that is put, and hands it to the invariants. The first violation ends a run.
"""

from hashlib import blake2b
from struct import pack
from typing import Any

from plant.sim.simulation import Plant
from protocol.wire.enums import Mode
from protocol.wire.enums import Vehicle as VehicleState
from protocol.wire.message import Message
from protocol.wire.reasons import Reason
from robot.core import states
from robot.core.machine import Machine
from robot.vehicle import Answer, Vehicle
from runtime.clock import Tick
from verification.simulation.hosts.operators import History
from verification.simulation.hosts.robot_side import RobotSide
from verification.simulation.hosts.scheduler import Host, Scheduler
from verification.simulation.invariants.commanding import Presence
from verification.simulation.invariants.persistence import Keeping
from verification.simulation.invariants.requests import Requests
from verification.simulation.invariants.robot_loop import Onboard
from verification.simulation.invariants.shared import Facts
from verification.simulation.invariants.wheels import Motion

FORGED_NS = 1_000_000_000
"""For so long after forged senses the robot may take its ticks at other times."""


class Oracle:
    """Ties the invariants to what is observed; `facts` tells how it went."""

    def __init__(self, scheduler: Scheduler, history: History) -> None:
        self.facts = Facts(scheduler, history)
        self.presence = Presence(self.facts)
        self.motion = Motion(self.facts, self.presence)
        self.requests = Requests(self.facts, self.presence)
        self.keeping = Keeping(self.facts)
        self.onboard = Onboard(self.facts, self.requests)
        self.digest = blake2b(digest_size=16)
        self._reached: set[str] = set()

    # The network.

    def put(self, source: Host, path: str, frame: bytes) -> None:
        """A frame leaves a host."""
        if path == "drive/wheels":
            if source.name == "robot":
                self.motion.command(frame)
            else:
                self.motion.forged(frame)
        elif path.startswith("sense/") and source.name != "plant":
            self.motion.place_known = False
            self.facts.held_up(self.facts.now_ns + FORGED_NS)

    # The plant.

    def plant_started(self) -> None:
        self.motion.plant_started()

    def plant_tick(self, plant: Plant) -> None:
        """After each period of the plant."""
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

    # The robot.

    def held_up(self, until_ns: int) -> None:
        self.facts.held_up(until_ns)

    def robot_started(self) -> None:
        """A robot process begins: it remembers nothing but what its disk has."""
        self.facts.armed_ns = self.facts.started_ns = self.facts.now_ns
        self.motion.robot_started()
        self.onboard.robot_started()
        self.presence.robot_started()

    def restored(self, vehicle: Vehicle) -> None:
        self.keeping.restored(vehicle)

    def received(self, vehicle: Vehicle, request: Message, answer: Answer, operator: str) -> None:
        """The robot has answered a request."""
        self.requests.received(vehicle, request, answer, operator)
        self.keeping.received(vehicle, request)

    def cycled(self, side: RobotSide, tick: Tick) -> None:
        """After each tick of the robot."""
        vehicle, process = side.vehicle, side.process
        if vehicle is None or process is None:
            return
        self.facts.coverage.robot_ticks += 1
        self._reach(vehicle.state.machine)
        self.onboard.cycled(vehicle, process)
        self.presence.cycled(vehicle)
        self.keeping.cycled(vehicle)

    def _reach(self, machine: Machine) -> None:
        """Count each vehicle state and each failsafe once per run."""
        state = VehicleState(machine.vehicle).name
        if machine.vehicle == states.FAILSAFE:
            state = f"{state} {Reason(machine.vehicle_reason).name}"
        elif machine.vehicle == states.ACTIVE:
            state = f"{state} {Mode(machine.mode).name}"
        if state not in self._reached:
            self._reached.add(state)
            self.facts.coverage.reached[state] += 1

    # Processes and what operators are told.

    def look(self, hosts: list[Host]) -> None:
        """Judge what has ended since the last look."""
        for asked in self.facts.history.ended():
            self.requests.told(asked)
            self.keeping.told(asked)
        for host in hosts:
            if host.error is not None:
                error: Any = host.error
                words = f"{host.name}: {type(error).__name__}: {error}"
                self.facts.fail("no process ends by itself", words)
