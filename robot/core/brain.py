"""Run one control cycle: sense, check, drive to the goal, guard. No clock, I/O or randomness."""

from math import inf, pi, sqrt
from typing import Final, NamedTuple, Protocol

from robot.core import modes, motion, place, reasons, states
from robot.core.motion import HALT, align, heading_error, into, limited, ramp, toward
from robot.core.navigators import registry
from robot.core.navigators.registry import NAVIGATORS
from robot.core.parameters import Params
from robot.core.perception import closing_speed, slip, sonar_ring, wall_heading
from robot.core.perception import odometry as odometries
from robot.core.perception import stall as stalls
from robot.core.safety import failsafe, guard
from robot.core.safety.guard import FRONT_BUMPER
from robot.core.state import State
from robot.core.values import Decision, Goal, Inputs, Outputs, Twist, wrap
from runtime.elementary import cos_sin

__all__ = ["State", "step"]

PERIOD_MS: Final = 50

READ: Final = 0
ODOMETRY: Final = 1
NAVIGATE: Final = 2
GUARD: Final = 3
WRITE: Final = 4

Stage = NamedTuple("Stage", [("name", str), ("host_us", int), ("mcu_percent", int)])

STAGES: Final = (
    Stage("read", 800, 4),
    Stage("odometry", 100, 6),
    Stage("navigate", 200, 20),
    Stage("guard", 100, 4),
    Stage("write", 1300, 4),
)
"""In the order of the cycle: 5 % of the period on the host, less than half of it on the MCU."""

TICK_US: Final = sum([stage.host_us for stage in STAGES])

LEAVE: Final = 3.0  # arrival is revoked beyond this many tolerances
CENTRE_M: Final = 0.02  # in the open, drive on to this distance or CENTRE_SHARE
CENTRE_SHARE: Final = 0.4
ALIGNED_RAD: Final = 1.8 * pi / 180.0  # the same limits for the heading
ALIGNED_SHARE: Final = 0.6
BESIDE_M: Final = 0.12  # a nearer obstacle may keep the robot from the goal
ELLIPSE: Final = 5.99  # squared radius of the 95 % ellipse, in standard deviations
MAX_VARIANCE_M2: Final = 0.03  # of the position, x and y together: 0.17 m squared
CROWDED: Final = 4  # ticks in a row with a near echo, to ignore false ones
ENDS: Final = {
    states.GIVE_UP: (states.STUCK, reasons.UNREACHABLE),
    states.LOST: (states.STUCK, reasons.LOST),
    states.FAILED: (states.ABORTED, reasons.NAVIGATOR_FAILED),
}
"""State and reason of a goal that a branch ends."""
STILL_M_S: Final = 0.02
STILL_RAD_S: Final = 0.10


def pursue(state: State, goal: Goal, now_ms: int, params: Params) -> Twist:
    """Return the twist towards the goal, and update the goal's state."""
    begin(state, now_ms)
    target = next_target(state, goal, now_ms)
    pose = state.odometry.pose
    dx_m, dy_m = target.x_m - pose.x_m, target.y_m - pose.y_m
    distance_m = sqrt(dx_m * dx_m + dy_m * dy_m)
    if target is goal:
        state.goal_distance_m = distance_m
        state.arrived = has_arrived(state, goal, distance_m, params)
        if state.arrived:
            return settle(state, goal, now_ms, params)
    patient = NAVIGATORS[state.machine.navigator].judges_progress
    reason = motion.judge(state.progress, pose, distance_m, now_ms, params, patient)
    if reason != reasons.OK:
        if target is goal and distance_m <= goal.position_tolerance_m:
            state.arrived = True
            return settle(state, goal, now_ms, params)
        modes.end_goal(state.machine, states.STUCK, reason, now_ms)
        return HALT
    return travel(state, target, distance_m, now_ms, params)


def has_arrived(state: State, goal: Goal, distance_m: float, params: Params) -> bool:
    """Return whether to stop here: within the tolerance, with no gain by driving on.

    In the open the robot drives on towards the centre while it lies ahead. With an obstacle near,
    the tolerance is enough, so that the robot does not insist on a blocked place. Beside one, the
    uncertainty of its own position is enough.
    """
    tolerance_m = goal.position_tolerance_m
    if state.arrived:
        return distance_m <= LEAVE * tolerance_m or may_be_on(state, goal, distance_m, params)
    if distance_m > tolerance_m:
        return is_beside(state, goal, distance_m, params)
    if distance_m <= min(tolerance_m, max(CENTRE_M, CENTRE_SHARE * tolerance_m)):
        return True
    state.crowded = state.crowded + 1 if state.ring.nearest_m < params.d_obs_m else 0
    if state.crowded >= CROWDED:
        return True
    return is_past(state, goal)


def is_past(state: State, goal: Goal) -> bool:
    """Return whether the goal no longer lies ahead."""
    pose = state.odometry.pose
    dx_m, dy_m = goal.x_m - pose.x_m, goal.y_m - pose.y_m
    cosine, sine = cos_sin(pose.heading_rad)
    return dx_m * cosine + dy_m * sine <= 0.0


def is_beside(state: State, goal: Goal, distance_m: float, params: Params) -> bool:
    """Return whether an obstacle keeps the robot from the goal on which it may stand.

    Over a long way the estimate drifts, and the goal then seems to lie too near to an obstacle, or
    a little within it. No echo is nearer than the goal, so no wall lies between.
    """
    nearest_m = state.ring.nearest_m
    if nearest_m > BESIDE_M or distance_m > params.radius_m + nearest_m:
        return False
    return is_past(state, goal) and may_be_on(state, goal, distance_m, params)


def may_be_on(state: State, goal: Goal, distance_m: float, params: Params) -> bool:
    """Return whether the goal is near, and within the 95 % ellipse of the position.

    If the ellipse is large, the goal may as well be behind the next wall.
    """
    odometry = state.odometry
    pose, pxx, pxy, pyy = odometry.pose, odometry.pxx, odometry.pxy, odometry.pyy
    if distance_m > params.radius_m + BESIDE_M or pxx + pyy > MAX_VARIANCE_M2:
        return False
    dx_m, dy_m = goal.x_m - pose.x_m, goal.y_m - pose.y_m
    apart = pyy * dx_m * dx_m - 2.0 * pxy * dx_m * dy_m + pxx * dy_m * dy_m
    return apart < ELLIPSE * (pxx * pyy - pxy * pxy)


def begin(state: State, now_ms: int) -> None:
    """Start a new goal or navigator with an empty memory; after a hold restart only the timers."""
    machine = state.machine
    if state.pursuits != machine.pursuits:
        state.pursuits = machine.pursuits
        state.memory = registry.new_memory(machine.navigator, machine.side, state.odometry)
        state.arrived = False
        state.crowded = 0
        state.driving = False
    if not state.driving:
        state.driving = True
        motion.restart(state.progress, state.odometry.pose, now_ms)


def next_target(state: State, goal: Goal, now_ms: int) -> Goal:
    """Return the goal, or on the way back the newest crumb of the trail."""
    if state.machine.mode != states.SMART_RTL:
        return goal
    trail, pose = state.trail, state.odometry.pose
    if motion.pass_crumb(trail, pose.x_m, pose.y_m):
        motion.restart(state.progress, pose, now_ms)
    if trail.count < 2:
        return goal
    last = trail.count - 1
    return Goal(
        trail.xs_m[last], trail.ys_m[last], None, motion.PASSED_M, goal.heading_tolerance_rad
    )


def travel(state: State, target: Goal, distance_m: float, now_ms: int, params: Params) -> Twist:
    """Let the navigator choose a direction, and return the twist for it.

    Near a goal with a heading, and in the open, the path bends so that the robot arrives with that
    heading.
    """
    pose, ring = state.odometry.pose, state.ring
    machine = state.machine
    decision = NAVIGATORS[machine.navigator].step(state.memory, pose, ring, target, params)
    state.decision = decision
    if decision.branch >= states.GIVE_UP:
        goal_state, reason = ENDS[decision.branch]
        modes.end_goal(machine, goal_state, reason, now_ms)
        return HALT
    turn_rad = wrap(decision.goal_bearing_rad + decision.rotation_rad)
    if decision.branch != states.TO_GOAL:
        machine.goal_state = states.AVOIDING
        speed_m_s, yaw_rate_rad_s = toward(distance_m, turn_rad, params)
    else:
        machine.goal_state = states.DRIVING
        near = distance_m < params.pose_from_m and ring.nearest_m >= params.d_obs_m
        if near and target.heading_rad is not None:
            sight_rad = pose.heading_rad + decision.goal_bearing_rad
            approach_rad = wrap(sight_rad - target.heading_rad)
            speed_m_s, yaw_rate_rad_s = into(distance_m, turn_rad, approach_rad, params)
        else:
            speed_m_s, yaw_rate_rad_s = toward(distance_m, turn_rad, params)
    limit_m_s = decision.speed_limit_m_s
    narrow = ring.front_m < params.spin_room_m and limit_m_s == inf
    if narrow or state.bumper & FRONT_BUMPER:
        speed_m_s = 0.0
    if limit_m_s == inf:
        speed_m_s = closing_speed.limit_m_s(ring, speed_m_s)
    elif limit_m_s < speed_m_s:
        speed_m_s = limit_m_s
    speed_m_s, yaw_rate_rad_s = limited(speed_m_s, yaw_rate_rad_s, params)
    return Twist(speed_m_s, yaw_rate_rad_s)


def settle(state: State, goal: Goal, now_ms: int, params: Params) -> Twist:
    """Turn to the final heading and stop; then end the goal as reached."""
    machine, pose = state.machine, state.odometry.pose
    if goal.heading_rad is not None:
        error_rad = heading_error(goal.heading_rad, pose.heading_rad)
        standing = state.twist.yaw_rate_rad_s == 0.0
        tolerance_rad = goal.heading_tolerance_rad
        close_rad = min(tolerance_rad, max(ALIGNED_RAD, ALIGNED_SHARE * tolerance_rad))
        close_rad *= 1.0 if standing else 0.5
        if abs(error_rad) > close_rad:
            machine.goal_state = states.ALIGNING
            state.decision = Decision(
                states.ALIGN, None, state.ring.nearest_m, error_rad, 0.0, goal.x_m, goal.y_m, inf
            )
            return Twist(0.0, align(error_rad, params))
    if is_still(state):
        modes.end_goal(machine, states.REACHED, reasons.OK, now_ms)
    return HALT


def is_still(state: State) -> bool:
    """Return whether the robot is commanded to stop and has stopped."""
    odometry = state.odometry
    return (
        state.twist.speed_m_s == 0.0
        and state.twist.yaw_rate_rad_s == 0.0
        and abs(odometry.speed_m_s) <= STILL_M_S
        and abs(odometry.yaw_rate_rad_s) <= STILL_RAD_S
    )


class StageHook(Protocol):
    """A callback with the number of each finished stage, by which a host measures time."""

    def __call__(self, __stage: int) -> None:
        """Note the end of a stage."""


def ignore(_stage: int) -> None:
    """Ignore the end of a stage."""


def step(
    state: State, inputs: Inputs, params: Params, mark: StageHook = ignore
) -> tuple[State, Outputs]:
    """Run one tick: from the inputs to the wheel speeds until the next tick."""
    sense(state, inputs, params)
    failsafe.check(state, inputs, params)
    mark(ODOMETRY)
    wanted = decide(state, inputs, params)
    mark(NAVIGATE)
    outputs = act(state, wanted, inputs, params)
    mark(GUARD)
    return state, outputs


def sense(state: State, inputs: Inputs, params: Params) -> None:
    """Update pose, sonar ring and monitors; the first complete set of inputs ends BOOT."""
    now_ms, wheels, scan, age_ms = inputs
    odometry, machine = state.odometry, state.machine
    heading_rad = odometry.pose.heading_rad
    if wheels is not None and not odometry.latched and not place.is_at_start(odometry, wheels):
        machine.placed = False
    odometries.update(odometry, wheels, params)
    turned_rad = wrap(odometry.pose.heading_rad - heading_rad)
    sonar_ring.update(state.ring, scan, now_ms, params)
    if scan is not None:
        closing_speed.watch(state.ring.pedestrians, state.ring, odometry, params)
    sonar_ring.watch(state.frozen, scan, odometry.moved_m, turned_rad, params)
    if wheels is not None:
        state.bumped = wheels.bumper & ~state.bumper != 0
        state.bumper = wheels.bumper
        slip.watch(state.slip, odometry, state.ring, params)
        stalls.watch(state.stall, odometry, now_ms, params)
        wall_heading.watch(state.walls, odometry, state.ring, state.slip, params)
    machine.operator = age_ms is not None and age_ms <= params.op_lost_ms
    machine.senses = wheels is not None and scan is not None
    if machine.vehicle == states.BOOT and machine.senses:
        machine.vehicle = states.STANDBY
    if machine.mode != states.SMART_RTL:
        motion.drop_crumb(state.trail, odometry.pose.x_m, odometry.pose.y_m)


def decide(state: State, inputs: Inputs, params: Params) -> Twist:
    """Return the wanted twist: to the goal, as the operator steers, or a stop."""
    machine, goal = state.machine, state.machine.goal
    state.decision = None
    if machine.vehicle != states.ACTIVE:
        state.driving = False
        return HALT
    if goal is None or not modes.drives(machine):
        state.driving = False
        if machine.mode == states.MANUAL:
            return steer(state, params)
        return ramp(HALT, state.twist, params)
    wanted = pursue(state, goal, inputs.now_ms, params)
    return ramp(wanted, state.twist, params)


def steer(state: State, params: Params) -> Twist:
    """Return the operator's twist in MANUAL within the robot's limits; halt without one."""
    manual = state.manual
    if manual is None:
        return HALT
    speed_m_s, fastest_m_s = manual.speed_m_s, params.v_max_m_s
    if abs(speed_m_s) > fastest_m_s:  # NaN stays NaN, so that the guard detects it
        speed_m_s = fastest_m_s if speed_m_s > 0.0 else -fastest_m_s
    speed_m_s, yaw_rate_rad_s = limited(speed_m_s, manual.yaw_rate_rad_s, params)
    return ramp(Twist(speed_m_s, yaw_rate_rad_s), state.twist, params)


def act(state: State, wanted: Twist, inputs: Inputs, params: Params) -> Outputs:
    """Apply the guard; return wheel speeds in whole mrad/s, truncated so that none increases."""
    speed_m_s, yaw_rate_rad_s = wanted
    factor, reason = guard.limit(speed_m_s, yaw_rate_rad_s, state.ring, inputs.wheels, params)
    twist = wanted
    if reason != reasons.OK:
        twist = Twist(speed_m_s * factor, yaw_rate_rad_s * factor)
        if factor == 0.0:
            twist = HALT
        speed_m_s, yaw_rate_rad_s = twist
    state.twist = wanted if reason == reasons.NOT_FINITE else twist
    half_m_s = 0.5 * params.track_m * yaw_rate_rad_s
    left_m_s, right_m_s = speed_m_s - half_m_s, speed_m_s + half_m_s
    stall, now_ms = state.stall, inputs.now_ms
    stalls.command(stall.left, left_m_s, now_ms, params)
    stalls.command(stall.right, right_m_s, now_ms, params)
    scale = 1000.0 / params.wheel_radius_m
    left_share, right_share = odometries.wheel_shares(params)
    left_mrad_s = int(left_m_s * scale / left_share)
    right_mrad_s = int(right_m_s * scale / right_share)
    return Outputs(left_mrad_s, right_mrad_s, reason, twist, state.decision)
