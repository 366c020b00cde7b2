"""A whole stack in one process, as Zenoh peers on loopback, in simulated time.

Frames travel over real sockets. A control period of simulated time passes when all frames of a tick
have arrived. Nothing sleeps: waiting for a frame is a condition with a deadline.
"""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from math import degrees, inf, radians
from typing import Final, Self

from checks.harness.bus_calls import OPERATOR_BEAT, command_request
from checks.harness.motion import is_still
from checks.harness.peers import FRAME_S, REPORTED, Peers
from plant.model.configuration import Fault
from protocol.bus.bus import Bus
from protocol.outcome import wire_goal
from protocol.topics import COMMAND, CYCLE, DRIVE, Service
from protocol.wire.enums import Command, GoalState, Mode
from protocol.wire.enums import Vehicle as VehicleState
from protocol.wire.message import Message
from protocol.wire.messages import (
    CommandAck,
    GoalRequest,
    GroundTruth,
    NavigatorStatus,
)
from protocol.wire.reasons import Reason
from runtime.clock import Tick
from runtime.units import NS_PER_S, PERIOD_NS

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
    def state(self) -> VehicleState:
        """The state of the vehicle."""
        return VehicleState(self.vehicle.state.machine.vehicle)

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
