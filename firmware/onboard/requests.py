"""Requests of the host: set-up, parameters, fence, goals and commands."""

from math import isfinite
from struct import unpack_from
from typing import Final

import board
import outputs
import wire
from onboard import Onboard

from robot.core import modes, place, reasons, states
from robot.core.parameters import Params
from robot.core.safety import failsafe
from robot.core.safety.fence import MAX_CORNERS, Fence
from robot.core.state import State
from robot.core.values import Goal, Pose

PER_M: Final = 10_000
MAX_INTEGER: Final = 0x3FFFFFFF


def handle(onboard: Onboard, message_id: int) -> None:
    """Execute a request, answer it, and send the state after it."""
    onboard.requests = onboard.requests + 1 & MAX_INTEGER
    if message_id == wire.BOARD_PARAMETER_ID:
        reason = set_parameter(onboard)
    elif message_id == wire.BOARD_SETUP_ID:
        reason = set_up(onboard)
    elif onboard.state is None:
        reason = reasons.NO_SENSES
    elif message_id == wire.BOARD_GOAL_ID:
        reason = go(onboard)
    elif message_id == wire.BOARD_COMMAND_ID:
        reason = command(onboard)
    elif message_id == wire.BOARD_STOP_ID:
        reason = stop(onboard)
    elif message_id == wire.BOARD_FENCE_ID:
        reason = set_fence(onboard)
    else:
        reason = reasons.UNKNOWN_COMMAND
    outputs.send_answer(onboard, message_id, reason)
    if onboard.state is not None:
        outputs.send_state(onboard)


def set_up(onboard: Onboard) -> int:
    """Create the core afresh at a pose."""
    x_m, y_m, heading_rad, left, right, silence_ms, fence_lost = unpack_from(
        wire.BOARD_SETUP_FORMAT, board.inbox
    )
    if not (isfinite(x_m) and isfinite(y_m) and isfinite(heading_rad)):
        return reasons.PARAMETER_OUT_OF_RANGE
    onboard.state = None
    onboard.state = state = State(onboard.params)
    odometry = state.odometry
    odometry.pose = Pose(x_m, y_m, heading_rad)
    odometry.left, odometry.right = left, right
    onboard.silence_ms = silence_ms
    onboard.wheels = onboard.scan = None
    if fence_lost:
        modes.lose_fence(state.machine)
    return reasons.OK


def set_parameter(onboard: Onboard) -> int:
    """Set one parameter; a whole number must fit the small integers of the board."""
    value, index = unpack_from(wire.BOARD_PARAMETER_FORMAT, board.inbox)
    values = list(onboard.params)
    if index >= len(values):
        return reasons.UNKNOWN_PARAMETER
    if not isfinite(value):
        return reasons.PARAMETER_OUT_OF_RANGE
    if isinstance(values[index], int):
        if not -MAX_INTEGER <= value <= MAX_INTEGER or int(value) != value:
            return reasons.PARAMETER_OUT_OF_RANGE
        value = int(value)
    values[index] = value
    params = Params(*values)
    if onboard.state is not None:
        machine = onboard.state.machine
        if (params.navigator, params.side) != (onboard.params.navigator, onboard.params.side):
            reason = modes.set_navigator(machine, params.navigator, params.side)
            if reason != reasons.OK:
                return reason
        machine.goal_max_m = params.goal_max_m
    onboard.params = params
    return reasons.OK


def set_fence(onboard: Onboard) -> int:
    """Replace or remove the fence, or add an exclusion to it."""
    values = unpack_from(wire.BOARD_FENCE_FORMAT, board.inbox)
    corners, is_exclusion = values[-2:]
    if corners > MAX_CORNERS:
        return reasons.FENCE_NOT_SIMPLE
    fence = None
    if corners:
        xs_m = tuple([value / PER_M for value in values[1 : 1 + corners]])
        second = 1 + MAX_CORNERS
        ys_m = tuple([value / PER_M for value in values[second : second + corners]])
        fence = Fence(xs_m, ys_m, values[0])
    machine, pose = onboard.state.machine, onboard.state.odometry.pose
    if is_exclusion and fence is not None:
        exclusions = list(machine.exclusions)
        exclusions.append(fence)
        return modes.set_fence(machine, machine.fence, pose, tuple(exclusions))
    return modes.set_fence(machine, fence, pose)


def go(onboard: Onboard) -> int:
    """Drive to a goal."""
    now_ms, x_m, y_m, heading_rad, position_m, tolerance_rad, mode, from_robot = unpack_from(
        wire.BOARD_GOAL_FORMAT, board.inbox
    )
    heading_rad = None if heading_rad != heading_rad else heading_rad
    goal = Goal(x_m, y_m, heading_rad, position_m, tolerance_rad)
    return modes.goto(onboard.state.machine, goal, mode, now_ms, from_robot != 0)


def stop(onboard: Onboard) -> int:
    """Stop for a reason of the host."""
    now_ms, reason, extent = unpack_from(wire.BOARD_STOP_FORMAT, board.inbox)
    machine = onboard.state.machine
    if extent == wire.STOP_PLACE:
        machine.placed = False
    elif extent == wire.STOP_GOAL:
        modes.end_goal(machine, states.ABORTED, reason, now_ms)
    elif machine.vehicle == states.ACTIVE:
        failsafe.trip(machine, reason, now_ms)
    return reasons.OK


def command(onboard: Onboard) -> int:
    """Execute a command of an operator; missions run on the host."""
    now_ms, one, two, three, number = unpack_from(wire.BOARD_COMMAND_FORMAT, board.inbox)
    state = onboard.state
    machine = state.machine
    if number == wire.DO_FLIGHTTERMINATION:
        return modes.estop(machine, now_ms)
    if number == wire.SIDESTEP_CLEAR_EMERGENCY_STOP:
        return modes.clear_estop(machine)
    if number == wire.SIDESTEP_ABORT_GOAL:
        return modes.abort(machine, now_ms)
    if number == wire.NAV_RETURN_TO_LAUNCH:
        return modes.rtl(machine, state.trail, now_ms)
    if number == wire.DO_SET_MODE:
        return modes.set_mode(machine, state.trail, whole(two), now_ms)
    if number == wire.SIDESTEP_SET_NAVIGATOR:
        return modes.set_navigator(machine, whole(one), whole(two) or machine.side)
    if not isfinite(one):
        return reasons.PARAMETER_OUT_OF_RANGE
    if number == wire.COMPONENT_ARM_DISARM:
        return modes.arm(machine) if one else modes.disarm(machine, now_ms)
    if number == wire.DO_PAUSE_CONTINUE:
        return modes.resume(machine) if one else modes.hold(machine)
    if number == wire.SIDESTEP_SET_POSE and isfinite(two):
        return place.set_pose(state, Pose(one, two, three))
    return reasons.UNKNOWN_COMMAND


def whole(value: float) -> int:
    """Return a parameter as an integer; -256, which no command accepts, if out of range."""
    return int(value) if -256.0 <= value <= 256.0 else -256


def restart() -> None:
    """Reset the board if the confirmation of the message is right."""
    if unpack_from(wire.BOARD_RESTART_FORMAT, board.inbox)[0] == wire.BOARD_RESTART_ID:
        board.restart()
