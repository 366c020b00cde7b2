"""Invariants after each tick: modes, goals and missions, and what may turn the wheels."""

from math import hypot
from typing import Any

from checks.simulation.hosts.operators import OperatorRequest
from checks.simulation.invariants import limits
from checks.simulation.invariants.commanding import CommandingInvariants, RequestInvariants
from checks.simulation.invariants.limits import NEVER, PERIOD_NS, RunState
from plant.sim.simulation import Plant
from protocol.wire.codec import decode
from protocol.wire.messages import WheelCommand
from protocol.wire.reasons import Reason
from robot.core import reasons, states
from robot.core.modes import Machine, drives, goal_is_active
from robot.core.parameters import Params
from robot.core.values import wrap
from robot.vehicle import RobotVehicle
from runtime.errors import RemoteError
from runtime.units import NS_PER_MS

Place = tuple[float, float]


class WheelInvariants:
    """Checks each wheel command, and the plant's true state after each period."""

    def __init__(self, facts: RunState, presence: CommandingInvariants) -> None:
        self._facts = facts
        self._presence = presence
        self._move_ns = self._newest_ns = NEVER
        """The ticks that the newest command to move and the newest command answer."""
        self._armed_ns = NEVER
        self.place_known = True
        """True if the robot's odometry is based on true senses only."""
        self._restarted = False
        self._acknowledged_stops: list[OperatorRequest] = []

    # Wheel commands.

    def command(self, frame: bytes) -> None:
        """Check a wheel command of the robot when it is published."""
        facts = self._facts
        try:
            command = decode(frame).message
        except RemoteError:
            facts.fail("frames are readable", "the robot published an unreadable wheel command")
            return
        if not isinstance(command, WheelCommand):
            return
        tick_ns = command.sense_seq * PERIOD_NS
        if tick_ns > facts.plant_ns:  # it answers a former plant process
            return
        self._newest_ns = max(self._newest_ns, tick_ns)
        if command.left_mrad_s == 0 and command.right_mrad_s == 0:
            return
        self._move_ns = max(self._move_ns, tick_ns)
        vehicle = None if facts.robot is None else facts.robot.vehicle
        if vehicle is None:
            return
        machine = vehicle.state.machine
        if machine.vehicle != states.ACTIVE:
            facts.fail(
                "disarmed robot is at rest", f"command to move in vehicle state {machine.vehicle}"
            )
        else:
            self._presence.judge(vehicle)

    def forged(self, frame: bytes) -> None:
        """Record a forged wheel command, if it answers a past tick."""
        facts, command = self._facts, decode(frame).message
        if isinstance(command, WheelCommand):
            tick_ns = command.sense_seq * PERIOD_NS
            if tick_ns <= facts.plant_ns:
                facts.forged_ns = max(facts.forged_ns, tick_ns)

    # Events of the plant.

    def plant_started(self) -> None:
        """Reset: the plant's time restarts, and the robot has lost its position."""
        self._move_ns = self._newest_ns = self._facts.forged_ns = NEVER
        self.place_known = self._facts.plant_starts == 0
        self._facts.plant_starts += 1
        self._armed_ns = NEVER
        self._facts.started_ns = self._facts.now_ns

    def robot_started(self) -> None:
        """Record whether the robot has run before.

        A restarted robot takes its place as its start, and keeps within its fence by that.
        """
        robot = self._facts.robot
        self._restarted = robot is not None and robot.starts > 0

    def ticked(self, plant: Plant) -> float:
        """Check after a period; return the speed of the faster wheel."""
        facts, truth = self._facts, plant.truth()
        fastest_m_s = rim_m_s(plant)
        if facts.stands:
            return fastest_m_s
        moves = fastest_m_s > limits.STILL_M_S
        facts.coverage.plant_ticks += 1
        facts.coverage.moving_ticks += moves
        vehicle = None if facts.robot is None else facts.robot.vehicle
        if vehicle is not None and vehicle.state.machine.vehicle == states.ACTIVE:
            self._armed_ns = facts.plant_ns
        self._acknowledged()
        if moves:
            self._measure(vehicle)
        if moves and (self._braked() or not self._forged()):
            self._in_time(fastest_m_s)
            self._stops()
            if vehicle is not None and self.place_known:
                place = (truth.x_m, truth.y_m)
                is_told = self._restarted or facts.is_placed
                self._fence(vehicle, believed(vehicle) if is_told else place)
        return fastest_m_s

    def _measure(self, vehicle: RobotVehicle | None) -> None:
        """Measure how long the wheels turn after an event that must stop them."""
        facts, now_ns = self._facts, self._facts.now_ns
        if self._forged() or facts.awake_ns > now_ns - limits.CALM_NS:
            return
        if vehicle is None:
            if facts.robot is not None and facts.robot.starts and not facts.robot.host.alive:
                facts.worst("robot's death, wheels still turn", now_ns - facts.robot.died_ns)
            return
        machine = vehicle.state.machine
        lost = machine.vehicle_reason == reasons.OPERATOR_LOST
        if lost and machine.vehicle == states.FAILSAFE and now_ns > facts.unsure_until_ns:
            took_ns = now_ns - self._presence.beaten_ns(vehicle)
            facts.worst("operator's last heartbeat, wheels still turn", took_ns)
            limit_ns = limits.operator_lost_ns(vehicle.params.op_lost_ms) + limits.FAILSAFE_STOP_NS
            if took_ns > limit_ns and now_ns - facts.sound_since_ns > limits.CALM_NS:
                facts.fail(
                    "stopped in time",
                    f"wheels turn {took_ns // NS_PER_MS} ms after the last heartbeat was sent",
                )

    def _forged(self) -> bool:
        """Return whether a forged command may turn the wheels."""
        return self._facts.plant_ns - self._facts.forged_ns <= limits.COMMAND_STOP_NS

    def _braked(self) -> bool:
        """Return whether zero commands have lasted so long that forged ones are rejected."""
        facts = self._facts
        if facts.robot is None or not facts.robot.runs:
            return False
        since_ns = max(facts.sound_since_ns, facts.started_ns)
        return facts.plant_ns - self._move_ns > limits.BRAKED_NS < facts.now_ns - since_ns

    def _in_time(self, fastest_m_s: float) -> None:
        """Check that wheels turn no longer than the last command allows, and only while armed."""
        facts, now_ns = self._facts, self._facts.plant_ns
        age_ns = now_ns - self._move_ns
        silent = self._newest_ns <= self._move_ns
        limit_ns = limits.SILENT_STOP_NS if silent else limits.COMMAND_STOP_NS
        if age_ns > limit_ns:
            facts.fail(
                "stopped in time",
                f"wheels turn at {fastest_m_s:.3f} m/s, {age_ns // NS_PER_MS} ms after the tick of "
                f"the last command to move{', which was the last of all' if silent else ''}",
            )
        if now_ns - self._armed_ns > limits.DISARMED_STOP_NS:
            ago_ms = (now_ns - self._armed_ns) // NS_PER_MS
            facts.fail(
                "disarmed robot is at rest",
                f"wheels turn {ago_ms} ms after the robot was last armed",
            )

    def _stops(self) -> None:
        """Check for turning wheels that no emergency stop is due."""
        facts, now_ns = self._facts, self._facts.now_ns
        if facts.robot is None or not facts.robot.runs:
            return
        since_ns = max(facts.sound_since_ns, facts.armed_ns)
        for asked in facts.history.pressed:
            took_ns = now_ns - max(asked.asked_ns, since_ns)
            limit_ns = limits.stop_ns(asked.operator, is_heard=since_ns < asked.asked_ns)
            if asked.ended_ns is None and took_ns > limit_ns:
                facts.fail(
                    "stop takes effect in time",
                    f"wheels turn {took_ns // NS_PER_MS} ms after a stop was pressed",
                )
            elif since_ns < asked.asked_ns:
                facts.worst("stop pressed, wheels still turn", took_ns)
        for asked in self._acknowledged_stops:
            answered_ns = asked.ended_ns or now_ns
            since_answer_ns = now_ns - max(answered_ns, facts.awake_ns)
            if since_ns < asked.asked_ns:
                facts.worst("stop pressed, wheels still turn", now_ns - asked.asked_ns)
            sound = facts.sound_since_ns < answered_ns - limits.TICK_NS
            limit_ns = limits.ACKNOWLEDGED_STOP_NS if sound else limits.LOST_BRAKE_NS
            if facts.armed_ns < answered_ns and since_answer_ns > limit_ns:
                took_ms = since_answer_ns // NS_PER_MS
                facts.fail(
                    "acknowledged stop is effective",
                    f"wheels turn {took_ms} ms after the stop of {asked.operator} was acknowledged",
                )

    def _acknowledged(self) -> None:
        """Move the acknowledged stops out of the pending ones."""
        pressed = self._facts.history.pressed
        if any(asked.ended_ns is not None for asked in pressed):
            ended = [asked for asked in pressed if asked.ended_ns is not None]
            self._acknowledged_stops += [asked for asked in ended if asked.answered]
            self._facts.coverage.stops += sum(1 for asked in ended if asked.answered)
            pressed[:] = [asked for asked in pressed if asked.ended_ns is None]

    def _fence(self, vehicle: RobotVehicle, place: Place) -> None:
        fence = vehicle.state.machine.fence
        if fence is None:
            return
        if self._facts.now_ns - self._facts.placed_ns <= limits.FAILSAFE_STOP_NS:
            return  # a pose that was set may lie outside: it stops as in any failsafe
        out_m = limits.outside_m(*fence, *place)
        if out_m > limits.FENCE_M:
            self._facts.fail("inside the fence", f"moves {out_m:.2f} m outside the fence")


def believed(vehicle: RobotVehicle) -> Place:
    """Return the estimated position of the robot."""
    pose = vehicle.state.odometry.pose
    return pose.x_m, pose.y_m


def rim_m_s(plant: Plant) -> float:
    """Return the present speed of the faster wheel; the truth has the mean of the last period."""
    drive: Any = plant._vehicles[0].drive
    left, right = drive._motors
    return max(abs(float(left.speed_m_s)), abs(float(right.speed_m_s)))


CALM = (Reason.BUDGET, Reason.TICKS_LOST, Reason.SCAN_LOST, Reason.NAME_TAKEN)
"""Failsafes that cannot occur without a fault."""

SAFER_UP = {
    "guard_stop_m": True,
    "guard_time_s": True,
    "op_lost_ms": False,
    "wheel_max_m_s": False,
    "freeze_m": False,
    "wheel_min_m_s": False,
}
"""Safety parameters, and whether a greater value is safer."""

AWAY_M = 0.05
AWAY_RAD = 0.35


class LoopInvariants:
    """Checks the vehicle; `moved` records its true pose."""

    def __init__(self, facts: RunState, requests: RequestInvariants) -> None:
        self._facts = facts
        self._requests = requests
        self._cycled_ns: int | None = None
        self._mode: int | None = None
        self._failsafe = False
        self._armed_with: tuple[float, ...] | None = None
        self._stray_ticks = 0
        self._params: Params | None = None
        self._active = False
        self._place = self._anchor = (0.0, 0.0, 0.0)
        self._moved_ns = 0

    def robot_started(self) -> None:
        """Reset at the start of a robot process."""
        self._mode = self._cycled_ns = self._armed_with = None
        self._failsafe = False

    def moved(self, x_m: float, y_m: float, heading_rad: float) -> None:
        """Record the true pose."""
        self._place = x_m, y_m, heading_rad

    def cycled(self, vehicle: RobotVehicle, process: Any) -> None:
        """Check after each tick."""
        machine = vehicle.state.machine
        self._ticks()
        self._goals(vehicle, machine)
        self._causes(vehicle)
        self._safety(vehicle)
        self._progress(machine)
        self._modes(machine)
        for queue in (process._requests, process._unprivileged, *process._halting):
            if queue.qsize() > limits.BACKLOG:
                self._facts.fail("queues are bounded", f"{queue.qsize()} requests wait in one")

    def _ticks(self) -> None:
        facts, now_ns = self._facts, self._facts.now_ns
        last_ns, self._cycled_ns = self._cycled_ns, now_ns
        gap_ns = 0 if last_ns is None else now_ns - last_ns
        if gap_ns > limits.TICK_GAP_NS and now_ns > facts.sound_since_ns:
            facts.fail(
                "no tick is missed", f"{gap_ns // NS_PER_MS} ms between two ticks of the robot"
            )

    def _goals(self, vehicle: RobotVehicle, machine: Machine) -> None:
        """Check that goals and missions end with arming; a mission notices at the next tick."""
        active = machine.vehicle == states.ACTIVE
        if goal_is_active(machine) and not active:
            self._facts.fail(
                "every goal ends",
                f"a goal is active in vehicle state {machine.vehicle}: it has no outcome",
            )
        self._stray_ticks = self._stray_ticks + 1 if vehicle.mission.active and not active else 0
        if self._stray_ticks > 2:
            self._facts.fail(
                "every goal ends", f"a mission runs in vehicle state {machine.vehicle}"
            )

    def _causes(self, vehicle: RobotVehicle) -> None:
        """Check that no failsafe trips without a fault or a forged frame for a while."""
        facts, machine = self._facts, vehicle.state.machine
        failsafe = machine.vehicle == states.FAILSAFE
        tripped, self._failsafe = failsafe and not self._failsafe, failsafe
        if not tripped or facts.now_ns - facts.sound_since_ns < limits.CALM_NS:
            return
        if facts.now_ns - max(facts.forged_ns, facts.started_ns) < limits.CALM_NS:
            return
        reason = Reason(machine.vehicle_reason)
        fence = machine.fence
        x_m, y_m = believed(vehicle) if facts.is_placed else self._place[:2]
        inner_m = (
            0.0
            if fence is None or not fence.radius_m
            else fence.radius_m - hypot(x_m - fence.xs_m[0], y_m - fence.ys_m[0])
        )
        if reason in CALM or (reason == Reason.FENCE_BREACHED and inner_m > limits.FENCE_M):
            facts.fail("every failsafe has a cause", f"{reason.name} without a fault")

    def _safety(self, vehicle: RobotVehicle) -> None:
        """Check that safety parameters are as safe as configured, and constant while armed."""
        assert self._facts.robot is not None
        params, configured = vehicle.params, self._facts.robot.params
        active = vehicle.state.machine.vehicle == states.ACTIVE
        if params is self._params and active == self._active:
            return
        self._params, self._active = params, active
        for name, up in SAFER_UP.items():
            value, limit = getattr(params, name), getattr(configured, name)
            if value < limit if up else value > limit:
                self._facts.fail("as safe as configured", f"{name} is {value:g}, not {limit:g}")
        values = tuple([getattr(params, name) for name in SAFER_UP])
        if active and self._armed_with not in (None, values):
            self._facts.fail("as safe as configured", f"{self._armed_with} became {values}, armed")
        self._armed_with = values if active else None

    def _progress(self, machine: Machine) -> None:
        """Check that the robot moves while it drives to a goal."""
        (x_m, y_m, heading_rad), anchor, now_ns = self._place, self._anchor, self._facts.now_ns
        away = hypot(x_m - anchor[0], y_m - anchor[1]) > AWAY_M
        turned = abs(wrap(heading_rad - anchor[2])) > AWAY_RAD
        if away or turned or not drives(machine) or self._facts.stands:
            self._anchor, self._moved_ns = self._place, now_ns
        elif now_ns - self._moved_ns > limits.STANDSTILL_NS:
            rest_s = (now_ns - self._moved_ns) // 1_000 // NS_PER_MS
            self._facts.fail(
                "every goal ends", f"a goal is active, the robot is at rest for {rest_s} s"
            )

    def _modes(self, machine: Machine) -> None:
        """Check that the mode changes only by a command."""
        before, self._mode = self._mode, machine.mode
        commanded, self._requests.commanded = self._requests.commanded, False
        if before is not None and not commanded and machine.mode != before:
            words = f"mode {before} became {machine.mode} without a command"
            self._facts.fail("mode changes only by command", words)
