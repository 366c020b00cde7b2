"""A whole stack in one process, as Zenoh peers on loopback; whoever owns it owns time.

Frames really travel over sockets; a period of simulated time goes by when all of a tick have
arrived. Nothing sleeps: waiting for a frame is a condition with a deadline.
"""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from math import degrees, inf, radians
from typing import Final, Self

from plant.model.faults import Fault
from protocol.bus.bus import Bus
from protocol.topics import COMMAND, CYCLE, DRIVE, Service
from protocol.wire.enums import AUTOPILOT_INVALID, TYPE_GCS, Command, GoalState, Mode
from protocol.wire.enums import Vehicle as VehicleState
from protocol.wire.message import Message
from protocol.wire.messages import (
    CommandAck,
    CommandRequest,
    GoalRequest,
    GroundTruth,
    Heartbeat,
    NavigatorStatus,
)
from protocol.wire.reasons import Reason
from runtime.clock import Tick
from runtime.timing import PERIOD_NS
from runtime.units import NS_PER_S
from verification.harness.peers import FRAME_S, TOLD, Peers

BEAT_TICKS: Final = 4
STILL_M_S: Final = 0.001
STILL_RAD_S: Final = 0.01
OPERATOR_BEAT: Final = Heartbeat(
    type=TYPE_GCS, autopilot=AUTOPILOT_INVALID, base_mode=0, custom_mode=0, system_status=4
)


class InProcess(Peers):
    """A stack that is driven tick by tick and looked at.

    `hanging` are those that stand still as if they hung: their links stay.
    """

    hanging: frozenset[str] = frozenset()

    def __enter__(self) -> Self:
        self.start_all()
        self.forward(0.05)
        return self

    def __exit__(self, *_: object) -> None:
        self.close_all()

    # Time: one period of 50 ms after another, in three phases.

    def forward(self, seconds: float) -> None:
        """Let this much simulated time go by."""
        for _ in range(round(seconds * 20)):
            self.cycle()

    def until(self, condition: Callable[[], bool], within_s: float = 120.0) -> float:
        """Go on until the condition holds; how long it took. AssertionError after `within_s`."""
        started_ns = self.clock.now_ns()
        while not condition():
            elapsed_s = (self.clock.now_ns() - started_ns) / NS_PER_S
            assert elapsed_s < within_s, f"not within {within_s} s: {self.describe()}"
            self.cycle()
        return (self.clock.now_ns() - started_ns) / NS_PER_S

    def cycle(self) -> None:
        for phase in self.phases:
            phase()

    @property
    def phases(self) -> tuple[Callable[[], None], ...]:
        """Of one period: the senses arrive, the robot thinks, its command arrives and time goes."""
        return self._sense, self._think, self._act

    def _sense(self) -> None:
        if self.operator and self._ticks % BEAT_TICKS == 0:
            self._send(self._beat.key, lambda: self._beat.put(OPERATOR_BEAT), self.robot)
        if self.plant is not None and "plant" not in self.hanging:
            wires = self.plant.wires[0]
            self._send(wires.publishers[-1].key, self.plant.publish, self.robot)

    def _think(self) -> None:
        if self.robot is None or "robot" in self.hanging:
            return
        self.buses["robot"].line.release(self.clock.now_ns())
        plant, ground = self.key_at_plant, TOLD
        told = self._arrivals.count(plant), self._arrivals.count(ground)
        self.robot.cycle(Tick(self._ticks, self.clock.now_ns(), 0, 0))
        if self._listening:
            self._arrivals.wait(lambda: self._arrivals.count(ground) > told[1], CYCLE.path)
        if self.plant is not None:
            self._arrivals.wait(lambda: self._arrivals.count(plant) > told[0], DRIVE.path)

    @property
    def key_at_plant(self) -> str:
        """By which arrivals of wheel commands at the plant are counted."""
        return f"{self.buses['robot'].key(DRIVE.path)} at the plant"

    def _act(self) -> None:
        if self.plant is not None and "plant" not in self.hanging:
            self.buses["plant"].line.release(self.clock.now_ns())
            self.plant.advance()
        self._ticks += 1
        self.clock.advance(PERIOD_NS)

    def _send(self, key: str, put: Callable[[], object], receiver: object) -> None:
        """Put something and wait until the robot has it."""
        seen = self._arrivals.count(key)
        put()
        if receiver is not None:
            self._arrivals.wait(lambda: self._arrivals.count(key) > seen, key)

    def send(self, key: str, put: Callable[[], object]) -> None:
        """Put something for the robot, and wait until it is there."""
        self._send(key, put, self.robot)

    # The operator: requests and what can be seen.

    def ask(
        self, request: Message, service: Service = COMMAND, asker: Bus | None = None
    ) -> Message:
        """Ask over the bus while the robot's loop goes round; its answer."""
        with ThreadPoolExecutor(1) as pool:
            answer = pool.submit((asker or self.ground).ask, service, request, FRAME_S)
            while not answer.done():
                if self.robot is not None:
                    self.robot.idle()
            found = answer.result()
        assert not isinstance(found, bytes)
        return found

    def command(self, command: Command, param1: float = 0.0, param2: float = 0.0) -> Reason:
        self._commands += 1
        request = CommandRequest(
            request_id=self._commands, command=command, param1=param1, param2=param2
        )
        return reason_in(self.ask(request))

    def arm(self) -> Reason:
        return self.command(Command.COMPONENT_ARM_DISARM, 1)

    def goto(
        self, x_m: float, y_m: float, deg: float | None = None, mode: Mode = Mode.GUIDED
    ) -> Reason:
        self._commands += 1
        request = GoalRequest(
            request_id=self._commands,
            x_mm=round(x_m * 1000),
            y_mm=round(y_m * 1000),
            heading_urad=round(radians(deg or 0.0) * 1e6),
            heading_free=int(deg is None),
            position_tolerance_mm=50,
            heading_tolerance_urad=52_360,
            mode=mode,
        )
        return reason_in(self.ask(request))

    def goto_goal(self, mode: Mode = Mode.GUIDED) -> Reason:
        """To the goal of the world."""
        goal = self.world.goal
        heading_rad = goal.heading_rad
        return self.goto(
            goal.x_m, goal.y_m, None if heading_rad is None else degrees(heading_rad), mode
        )

    @property
    def status(self) -> NavigatorStatus:
        """What the operator was told last."""
        newest = self._status.latest()
        assert newest is not None, "no status has arrived"
        return newest[0]

    @property
    def truth(self) -> GroundTruth:
        assert self.plant is not None
        return self.plant.plant.truth()

    @property
    def senses_used(self) -> tuple[int, int]:
        """The numbers of the wheel ticks and of the scan that the robot used last."""
        return self._senses.wheels_seq, self._senses.scan_seq

    @property
    def goal_state(self) -> GoalState:
        return GoalState(self.vehicle.state.machine.goal_state)

    @property
    def state(self) -> VehicleState:
        return VehicleState(self.vehicle.state.machine.vehicle)

    @property
    def why(self) -> Reason:
        """Why the vehicle is in its state."""
        return Reason(self.vehicle.state.machine.vehicle_reason)

    def reached(self) -> bool:
        return self.goal_state == GoalState.REACHED

    def standing(self) -> bool:
        truth = self.truth
        return abs(truth.speed_m_s) < STILL_M_S and abs(truth.yaw_rate_rad_s) < STILL_RAD_S

    def driving(self) -> bool:
        """Well under way."""
        return self.truth.speed_m_s > 0.2

    def describe(self) -> str:
        machine = self.vehicle.state.machine
        where = f"at {self.truth.x_m:.2f}, {self.truth.y_m:.2f}; " if self.plant else ""
        return f"{where}{self.state.name} ({self.why.name}), goal {self.goal_state.name}" + (
            f" ({Reason(machine.goal_reason).name})"
        )

    # Faults, by the names of a world file's [[fault]] and of what happens to processes.

    def inject(self, kind: str, target: str = "", value: float = 0.0, for_s: float = inf) -> None:
        """From now on, for so long."""
        assert self.plant is not None
        now_s = self.plant.plant.now_ns / NS_PER_S
        self.plant.plant.inject(Fault(kind, target, now_s, now_s + for_s, value))

    def clear_faults(self) -> None:
        assert self.plant is not None
        self.plant.plant.clear_faults()


def reason_in(answer: Message) -> Reason:
    assert isinstance(answer, CommandAck)
    return Reason(answer.result_param2)
