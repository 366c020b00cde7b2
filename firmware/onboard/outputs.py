"""Outputs of a tick, and the other messages of the board."""

from math import nan
from struct import pack_into
from typing import Final

import board
import wire
from onboard import Onboard

from robot.core import states
from robot.core.values import Goal, Outputs

TTL_MS: Final = 150
CLOCK_NS: Final = 40
CLOCK_MASK: Final = 0x3FFFFFFF


def send_hello(onboard: Onboard) -> None:
    """Send BOARD_HELLO: core, memory, parameters and the cause of the reset."""
    pack_into(
        wire.BOARD_HELLO_FORMAT,
        board.outbox,
        0,
        board.flash_bytes(),
        board.static_bytes(),
        board.HEAP_BYTES,
        board.stack_bytes(),
        board.CORE_HASH,
        board.CORE_VERSION,
        board.FLOAT_BITS,
        len(onboard.params),
        board.reset_cause(),
    )
    board.send(wire.BOARD_HELLO_ID, wire.BOARD_HELLO_SIZE)


def send_answer(onboard: Onboard, message_id: int, reason: int) -> None:
    """Answer a request."""
    pack_into(wire.BOARD_ANSWER_FORMAT, board.outbox, 0, onboard.requests, message_id, reason)
    board.send(wire.BOARD_ANSWER_ID, wire.BOARD_ANSWER_SIZE)


def send_command(onboard: Onboard, left_mrad_s: int, right_mrad_s: int) -> None:
    """Send the wheel speeds."""
    onboard.commands = onboard.commands + 1 & 0x3FFFFFFF
    pack_into(
        wire.WHEEL_COMMAND_FORMAT,
        board.outbox,
        0,
        onboard.stamp,
        onboard.commands,
        onboard.sense_seq,
        0,
        left_mrad_s,
        right_mrad_s,
        TTL_MS,
    )
    board.send(wire.WHEEL_COMMAND_ID, wire.WHEEL_COMMAND_SIZE)


def send_tick(onboard: Onboard, chosen: "Outputs | None") -> None:
    """Send odometry, decision and state."""
    send_odometry(onboard)
    if chosen is not None:
        send_decision(onboard, chosen)
    send_state(onboard)


def send_odometry(onboard: Onboard) -> None:
    """Send pose and covariance; its values are NaN while the place is unknown."""
    odometry = onboard.state.odometry
    x_m, y_m, heading_rad = odometry.pose
    placed = onboard.state.machine.placed
    pack_into(
        wire.PLANAR_ODOMETRY_FORMAT,
        board.outbox,
        0,
        onboard.stamp,
        x_m,
        y_m,
        heading_rad,
        odometry.speed_m_s,
        odometry.yaw_rate_rad_s,
        odometry.pxx if placed else nan,
        odometry.pxy if placed else nan,
        odometry.pxh if placed else nan,
        odometry.pyy if placed else nan,
        odometry.pyh if placed else nan,
        odometry.phh if placed else nan,
    )
    board.send(wire.PLANAR_ODOMETRY_ID, wire.PLANAR_ODOMETRY_SIZE)


def send_decision(onboard: Onboard, chosen: Outputs) -> None:
    """Send AVOIDANCE_DECISION; values are NaN without a decision."""
    machine, params = onboard.state.machine, onboard.params
    zone_m = nan
    if machine.navigator == states.BUG:
        zone_m = params.d_th_m
    elif machine.navigator == states.VGM:
        zone_m = params.d_obs_m
    bearing_rad = range_m = goal_rad = rotation_rad = virtual_x_m = virtual_y_m = nan
    branch, decision = states.NO_BRANCH, chosen.decision
    if decision is not None:
        branch, bearing_rad, range_m, goal_rad, rotation_rad, virtual_x_m, virtual_y_m, _ = decision
        if bearing_rad is None:
            bearing_rad = nan
    speed_m_s, yaw_rate_rad_s = chosen.twist
    pack_into(
        wire.AVOIDANCE_DECISION_FORMAT,
        board.outbox,
        0,
        onboard.stamp,
        bearing_rad,
        range_m,
        zone_m,
        goal_rad,
        rotation_rad,
        virtual_x_m,
        virtual_y_m,
        speed_m_s,
        yaw_rate_rad_s,
        branch,
        chosen.guard,
    )
    board.send(wire.AVOIDANCE_DECISION_ID, wire.AVOIDANCE_DECISION_SIZE)


def send_state(onboard: Onboard) -> None:
    """Send BOARD_STATE."""
    state, machine = onboard.state, onboard.state.machine
    x_m, y_m, heading_rad = state.odometry.pose
    goal_x_m, goal_y_m, goal_heading_rad = goal_pose(machine.goal)
    pack_into(
        wire.BOARD_STATE_FORMAT,
        board.outbox,
        0,
        machine.goal_started_ms,
        machine.goal_ended_ms,
        x_m,
        y_m,
        heading_rad,
        goal_x_m,
        goal_y_m,
        goal_heading_rad,
        state.goal_distance_m,
        state.slip.share,
        onboard.tick,
        machine.serial,
        machine.replaced_serial,
        machine.pursuits,
        state.trail.count,
        machine.vehicle,
        machine.vehicle_reason,
        machine.mode,
        machine.resume_mode,
        machine.goal_state,
        machine.goal_reason,
        machine.cause,
        machine.navigator,
        machine.side,
        flags_of(onboard),
    )
    board.send(wire.BOARD_STATE_ID, wire.BOARD_STATE_SIZE)


def goal_pose(goal: "Goal | None") -> "tuple[float, float, float]":
    """Return position and heading of a goal, with NaN for those that it does not have."""
    if goal is None:
        return nan, nan, nan
    heading_rad = goal.heading_rad
    return goal.x_m, goal.y_m, nan if heading_rad is None else heading_rad


def flags_of(onboard: Onboard) -> int:
    """Return the conditions of the core as bits."""
    machine = onboard.state.machine
    flags = wire.BOARD_PLACED if machine.placed else 0
    flags |= wire.BOARD_SENSES if machine.senses else 0
    flags |= wire.BOARD_OPERATOR if machine.operator else 0
    flags |= wire.BOARD_FENCE if machine.fence is not None else 0
    flags |= wire.BOARD_FENCE_LOST if machine.fence_unreadable else 0
    return flags | (wire.BOARD_STEERED if onboard.steered else 0)


def send_report(onboard: Onboard, command_clocks: int, used: int) -> None:
    """Send the cost of the tick; `used` are the bytes of the heap in use now."""
    onboard.peak = max(onboard.peak, used)
    pack_into(
        wire.BOARD_REPORT_FORMAT,
        board.outbox,
        0,
        onboard.tick,
        command_clocks * CLOCK_NS,
        busy_clocks(onboard) * CLOCK_NS,
        onboard.live,
        onboard.peak,
        max(used - onboard.live, 0),
        board.stack_peak(),
        board.skipped(),
        board.refused(),
        board.unsent(),
        onboard.silences,
    )
    board.send(wire.BOARD_REPORT_ID, wire.BOARD_REPORT_SIZE)


def busy_clocks(onboard: Onboard) -> int:
    """Return the time worked since the report before."""
    before, onboard.busy = onboard.busy, board.busy()
    return onboard.busy - before & CLOCK_MASK
