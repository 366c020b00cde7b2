"""What must hold at every tick, checked against the truth: the oracle of the simulation.

`Oracle` is told of every tick of plant and robot, of every request the robot has answered and of
every frame that is put. The first violation ends a run.
"""

from collections import deque
from hashlib import blake2b
from math import hypot
from struct import pack
from typing import Any, Final, NamedTuple

from plant.plant import Plant
from protocol.clock import Tick
from protocol.codec import decode
from protocol.enums import AckResult, Command, Mode
from protocol.enums import Vehicle as VehicleState
from protocol.errors import RemoteError
from protocol.message import Message
from protocol.messages import (
    CommandAck,
    CommandRequest,
    GoalRequest,
    LeaseRequest,
    MissionVerdict,
    WheelCommand,
)
from protocol.reasons import Reason
from robot.core import reasons, states
from robot.core.machine import goal_lives
from robot.lease import open_to_all
from robot.vehicle import Answer, Vehicle
from verification.simulation import limits
from verification.simulation.coverage import Coverage
from verification.simulation.operators import Asked, History
from verification.simulation.robot_side import RobotSide
from verification.simulation.scheduler import Host, Scheduler

MS: Final = 1_000_000


class Violation(NamedTuple):
    """Which invariant does not hold, when, and what was seen."""

    invariant: str
    time_ns: int
    words: str


class Acted(NamedTuple):
    """A request that the robot has answered."""

    time_ns: int
    request: Message
    ok: bool
    operator: str


class Oracle:
    """`violation` is the first one, None while all is well."""

    def __init__(self, scheduler: Scheduler, history: History) -> None:
        self.violation: Violation | None = None
        self.digest = blake2b(digest_size=16)
        self.coverage = Coverage()
        self._reached: set[str] = set()
        self.robot: RobotSide | None = None
        self.disturbed_until_ns = 0
        """Until then the robot's process is held up, so its ticks may be missed."""
        self.impaired_ns = -(1 << 62)
        """Until then the network is impaired."""
        self.stop_free_ns = 0
        self.heard_sent_ns: int | None = None
        self.forged_ns = -(1 << 62)
        """Plant time of the last forged wheel command."""
        self.place_known = True
        self.acted: deque[Acted] = deque(maxlen=4000)
        self.kept: dict[str, Any] = {}
        self._scheduler = scheduler
        self._history = history
        self._move_ns = -(1 << 62)
        self._plant_ns = 0
        self._cycled_ns: int | None = None
        self._machine: tuple[int, int, int] | None = None
        self._commanded = False
        self._stop_asked: dict[int, int] = {}

    def held_up(self, until_ns: int) -> None:
        """A process is killed, suspended or busy until then: its ticks may be missed."""
        self.disturbed_until_ns = max(self.disturbed_until_ns, until_ns)

    def impaired(self, until_ns: int) -> None:
        """The network is impaired until then."""
        self.impaired_ns = max(self.impaired_ns, until_ns)

    def fail(self, invariant: str, words: str) -> None:
        if self.violation is None:
            self.violation = Violation(invariant, self._scheduler.now_ns, words)

    # Frames.

    def put(self, source: Host, key: str, frame: bytes, note: bytes | None) -> None:
        """A frame leaves a host."""
        if key.endswith("drive/wheels") and source.name == "robot":
            self._wheel_command(frame)
        elif "/op/heartbeat" in key and source.name.startswith("operator"):
            self.heard_sent_ns = self._scheduler.now_ns

    def _wheel_command(self, frame: bytes) -> None:
        try:
            command = decode(frame).message
        except RemoteError:
            self.fail("frames", "the robot has put a wheel command that cannot be read")
            return
        if not isinstance(command, WheelCommand):
            return
        if command.left_mrad_s == 0 and command.right_mrad_s == 0:
            return
        self._move_ns = max(
            self._move_ns, min(command.sense_seq * limits.PERIOD_NS, self._plant_ns)
        )
        vehicle = None if self.robot is None else self.robot.vehicle
        if vehicle is not None and vehicle.state.machine.vehicle != states.ACTIVE:
            state = vehicle.state.machine.vehicle
            self.fail("still unless armed", f"command to move in vehicle state {state}")

    # The plant.

    def plant_tick(self, plant: Plant) -> None:
        """After each period of the plant."""
        truth = plant.truth()
        self.coverage.plant_ticks += 1
        if plant.now_ns < self._plant_ns:  # a plant that was started again
            self._move_ns = -(1 << 62)
            self.place_known = False
        self._plant_ns = plant.now_ns
        half_m_s = 0.5 * plant.body.track_m * truth.yaw_rate_rad_s
        fastest_m_s = abs(truth.speed_m_s) + abs(half_m_s)
        moves = fastest_m_s > limits.STILL_M_S
        self.coverage.moving_ticks += moves
        if moves and plant.now_ns - max(self._move_ns, self.forged_ns) > limits.COMMAND_STOP_NS:
            age_ms = (plant.now_ns - self._move_ns) // MS
            self.fail(
                "stopped in time",
                f"wheels turn at {fastest_m_s:.3f} m/s, {age_ms} ms after the tick of the last "
                "command to move",
            )
        self._stops(moves)
        self._fence(truth.x_m, truth.y_m, moves)
        machine = self.robot.vehicle.state.machine if self.robot and self.robot.vehicle else None
        seen = (0, 0, 0) if machine is None else (machine.vehicle, machine.mode, machine.goal_state)
        self.digest.update(
            pack("<4d4q", truth.x_m, truth.y_m, truth.heading_rad, fastest_m_s, *seen, 0)
            + pack("<2q", self._scheduler.now_ns, self._scheduler.events)
        )

    def _stops(self, moves: bool) -> None:
        """A stop that was pressed on a sound network works within its limit."""
        now_ns = self._scheduler.now_ns
        for number, pressed_ns in tuple(self._stop_asked.items()):
            sound = self.impaired_ns < pressed_ns and self.disturbed_until_ns < pressed_ns
            if not sound or self.robot is None or not self.robot.runs:
                del self._stop_asked[number]
            elif now_ns - pressed_ns > limits.STOP_NS:
                del self._stop_asked[number]
                if moves and self.stop_free_ns < pressed_ns:
                    self.fail(
                        "a stop stops",
                        f"wheels turn {(now_ns - pressed_ns) // MS} ms after a stop was pressed",
                    )

    def pressed(self) -> None:
        """An operator presses an emergency stop."""
        self._stop_asked[len(self._history.asked)] = self._scheduler.now_ns

    def _fence(self, x_m: float, y_m: float, moves: bool) -> None:
        vehicle = None if self.robot is None else self.robot.vehicle
        if vehicle is None or not moves or not self.place_known:
            return
        fence = vehicle.state.machine.fence
        if fence is None or not fence.radius_m or vehicle.state.machine.mode == states.MANUAL:
            return
        out_m = hypot(x_m - fence.xs_m[0], y_m - fence.ys_m[0]) - fence.radius_m
        if out_m > limits.FENCE_M:
            self.fail("inside the fence", f"moves {out_m:.2f} m outside the fence")

    # The robot.

    def received(self, vehicle: Vehicle, request: Message, answer: Answer, operator: str) -> None:
        """The robot has answered a request."""
        machine, now_ns = vehicle.state.machine, self._scheduler.now_ns
        ok = accepted(answer)
        self.coverage.requests += 1
        self.coverage.accepted += ok
        if isinstance(request, CommandRequest) and ok:
            self._commanded = True
            if request.command == Command.DO_FLIGHTTERMINATION:
                if machine.vehicle != states.EMERGENCY_STOP:
                    self.fail(
                        "an acknowledged stop is a stop",
                        f"a stop was accepted in vehicle state {machine.vehicle}",
                    )
            elif request.command == Command.COMPONENT_ARM_DISARM and request.param1:
                self.stop_free_ns = now_ns
        elif isinstance(request, GoalRequest) and ok:
            self._commanded = True
        holder = vehicle.lease.holder
        alien = holder is not None and holder.operator != operator
        if alien and ok and not open_to_all(request) and not isinstance(request, LeaseRequest):
            self.fail(
                "one commander", f"{type(request).__name__} of {operator or 'nobody'} accepted"
            )
        self._late(request, now_ns)
        self.acted.append(Acted(now_ns, request, ok, operator))

    def _late(self, request: Message, now_ns: int) -> None:
        """No request is acted on after its operator was told that there is no answer."""
        number = getattr(request, "request_id", 0)
        if not number:
            return
        for asked in reversed(self._history.asked):
            own = getattr(asked.request, "request_id", 0)
            if own == number and asked.ended_ns is not None and asked.answered is None:
                age_ns = now_ns - asked.ended_ns
                if age_ns > limits.LATE_REQUEST_NS:
                    self.fail(
                        "no late request",
                        f"{asked.action} acted on {age_ns // MS} ms after it was given up",
                    )
                return

    def cycled(self, side: RobotSide, tick: Tick) -> None:
        """After each tick of the robot."""
        vehicle, process, now_ns = side.vehicle, side.process, self._scheduler.now_ns
        if vehicle is None or process is None:
            return
        machine = vehicle.state.machine
        self.coverage.robot_ticks += 1
        self._reach(machine)
        last_ns, self._cycled_ns = self._cycled_ns, now_ns
        gap_ns = 0 if last_ns is None else now_ns - last_ns
        if gap_ns > limits.TICK_GAP_NS and now_ns > self.disturbed_until_ns:
            self.fail("ticks are kept", f"{gap_ns // MS} ms between two ticks of the robot")
        if goal_lives(machine) and machine.vehicle != states.ACTIVE:
            self.fail(
                "a goal ends", f"a goal lives in vehicle state {machine.vehicle}: it has no outcome"
            )
        self._mode(machine)
        self._operator(vehicle, now_ns)
        self._queues(process)

    def _reach(self, machine: Any) -> None:
        """Count each vehicle state and each failsafe once per run."""
        state = VehicleState(machine.vehicle).name
        if machine.vehicle == states.FAILSAFE:
            state = f"{state} {Reason(machine.vehicle_reason).name}"
        elif machine.vehicle == states.ACTIVE:
            state = f"{state} {Mode(machine.mode).name}"
        if state not in self._reached:
            self._reached.add(state)
            self.coverage.reached[state] += 1

    def _mode(self, machine: Any) -> None:
        """The mode changes by a command only."""
        now = (machine.serial, machine.mode, machine.vehicle)
        before, self._machine = self._machine, now
        commanded, self._commanded = self._commanded, False
        if before is None or commanded or now[1] == before[1]:
            return
        self.fail("mode by command", f"mode {before[1]} became {now[1]} without a command")

    def _operator(self, vehicle: Vehicle, now_ns: int) -> None:
        """In MANUAL, or with a goal in GUIDED, an operator has been sending lately."""
        machine = vehicle.state.machine
        if machine.vehicle != states.ACTIVE:
            return
        if machine.mode != states.MANUAL and not (
            machine.mode == states.GUIDED and goal_lives(machine)
        ):
            return
        limit_ns = vehicle.params.op_lost_ms * MS + limits.OPERATOR_SLACK_NS
        age_ns = None if self.heard_sent_ns is None else now_ns - self.heard_sent_ns
        if age_ns is None or age_ns > limit_ns:
            words = "never" if age_ns is None else f"{age_ns // MS} ms ago"
            self.fail("operator present", f"the last heartbeat was sent {words}")

    def _queues(self, process: Any) -> None:
        for name in ("_requests", "_stops", "_strangers"):
            line = getattr(process, name, None)
            if line is not None and line.qsize() > 64:
                self.fail("bounded", f"{line.qsize()} requests wait in {name}")

    def robot_started(self) -> None:
        """A robot process begins: it remembers nothing but what its disk has."""
        self._machine = self._cycled_ns = None
        self.stop_free_ns = self._scheduler.now_ns

    def ended(self, host: Host) -> None:
        """Judge a process that has ended by itself."""
        if host.error is not None:
            error = host.error
            self.fail("no process ends by itself", f"{host.name}: {type(error).__name__}: {error}")

    # What operators were told.

    def told(self, asked: Asked) -> None:
        """An operator has been told how its request ended."""
        if not asked.answered or asked.ended_ns is None:
            return
        if asked.action == "stop":
            self._stop_told(asked)
        elif asked.request is not None and hasattr(asked.request, "request_id"):
            self._request_told(asked)

    def _stop_told(self, asked: Asked) -> None:
        done = any(
            one.time_ns >= asked.asked_ns
            and isinstance(one.request, CommandRequest)
            and one.request.command == Command.DO_FLIGHTTERMINATION
            for one in self.acted
        )
        if not done:
            self.fail("an acknowledged stop is a stop", "no stop was acted on")

    def _request_told(self, asked: Asked) -> None:
        """The robot has acted on exactly this request."""
        for one in self.acted:
            if one.ok and one.request == asked.request and one.time_ns >= asked.asked_ns:
                return
        self.fail("acknowledged is done", f"{asked.action}: {asked.request}")


def accepted(answer: object) -> bool:
    if isinstance(answer, CommandAck):
        return answer.result == AckResult.ACCEPTED
    if isinstance(answer, MissionVerdict):
        return answer.reason == reasons.OK
    return True
