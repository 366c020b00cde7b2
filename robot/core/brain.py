"""One control cycle: sense, check, decide, act. No clock, no I/O, no randomness.

The budget of each stage of a control cycle: time on the host, share on the LPC1768.
"""

from typing import Final, NamedTuple, Protocol

from robot.core import modes as machines
from robot.core import motion as trails
from robot.core import place as places
from robot.core import pursuit, reasons, states
from robot.core.motion import HALT, limited, ramp
from robot.core.parameters import Params
from robot.core.perception import closing_speed, sonar_ring, wall_heading
from robot.core.perception import odometry as odometries
from robot.core.perception import slip as slips
from robot.core.perception import sonar_ring as rings
from robot.core.perception import stall as stalls
from robot.core.safety import failsafe, guard
from robot.core.state import State
from robot.core.values import Inputs, Outputs, Twist, wrap

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


__all__ = ["State", "step"]


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
    now_ms, wheels, scan = inputs.now_ms, inputs.wheels, inputs.scan
    odometry, machine = state.odometry, state.machine
    heading_rad = odometry.pose.heading_rad
    if wheels is not None and not odometry.latched and not places.is_at_start(odometry, wheels):
        machine.placed = False
    odometries.update(odometry, wheels, params)
    turned_rad = wrap(odometry.pose.heading_rad - heading_rad)
    rings.update(state.ring, scan, now_ms, params)
    if scan is not None:
        closing_speed.watch(state.ring.pedestrians, state.ring, odometry, params)
    sonar_ring.watch(state.frozen, scan, odometry.moved_m, turned_rad, params)
    if wheels is not None:
        state.bumped = wheels.bumper & ~state.bumper != 0
        state.bumper = wheels.bumper
        slips.watch(state.slip, odometry, state.ring, params)
        stalls.watch(state.stall, odometry, now_ms, params)
        wall_heading.watch(state.walls, odometry, state.ring, state.slip, params)
    age_ms = inputs.operator_age_ms
    machine.operator = age_ms is not None and age_ms <= params.op_lost_ms
    machine.senses = wheels is not None and scan is not None
    if machine.vehicle == states.BOOT and machine.senses:
        machine.vehicle = states.STANDBY
    if machine.mode != states.SMART_RTL:
        trails.drop_crumb(state.trail, odometry.pose.x_m, odometry.pose.y_m)


def decide(state: State, inputs: Inputs, params: Params) -> Twist:
    """Return the wanted twist: to the goal, as the operator steers, or a stop."""
    machine, goal = state.machine, state.machine.goal
    state.decision = None
    if machine.vehicle != states.ACTIVE:
        state.driving = False
        return HALT
    if goal is None or not machines.drives(machine):
        state.driving = False
        if machine.mode == states.MANUAL:
            return steer(state, params)
        return ramp(HALT, state.twist, params)
    wanted = pursuit.pursue(state, goal, inputs.now_ms, params)
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
