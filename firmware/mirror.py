"""Copy of the state of the core on a board, for the programs on the host that read it."""

from math import isnan, nan

from firmware.board import BoardOutputs
from protocol.wire.enums import (
    BOARD_FENCE_LOST,
    BOARD_OPERATOR,
    BOARD_PLACED,
    BOARD_SENSES,
)
from protocol.wire.messages import AvoidanceDecision, BoardState, PlanarOdometry
from robot.core import states
from robot.core.modes import Machine
from robot.core.state import State
from robot.core.values import Decision, Goal, Outputs, Pose, Twist


def follow(state: State, outputs: BoardOutputs) -> Outputs:
    """Copy the outputs of a tick into `state` and return them as the core would.

    The pose is exact. Decision, twist, speeds and covariance have the precision of the wire.
    """
    copy_state(state, outputs.state)
    copy_odometry(state, outputs.odometry)
    decision, command = outputs.decision, outputs.command
    if decision is None:
        state.decision, state.twist = None, Twist(0.0, 0.0)
        guard = 0
    else:
        state.decision = decision_of(decision)
        state.twist = Twist(decision.speed_m_s, decision.yaw_rate_rad_s)
        guard = decision.guard
    return Outputs(command.left_mrad_s, command.right_mrad_s, guard, state.twist, state.decision)


def copy_state(state: State, board: BoardState) -> None:
    """Copy BOARD_STATE into a state; it keeps its own trail and fence."""
    state.odometry.pose = Pose(board.x_m, board.y_m, board.heading_rad)
    state.goal_distance_m = board.goal_distance_m
    state.slip.share = board.slip_share
    copy_machine(state.machine, board)


def copy_machine(machine: Machine, board: BoardState) -> None:
    """Copy vehicle, mode and goal."""
    machine.vehicle, machine.vehicle_reason = board.vehicle, board.vehicle_reason
    machine.mode, machine.resume_mode = board.mode, board.resume_mode
    machine.goal_state, machine.goal_reason = board.goal, board.goal_reason
    machine.goal_started_ms, machine.goal_ended_ms = board.goal_started_ms, board.goal_ended_ms
    machine.serial, machine.replaced_serial = board.serial, board.replaced_serial
    machine.pursuits = board.pursuits
    machine.cause = board.cause
    machine.navigator, machine.side = board.navigator, board.side
    machine.placed = bool(board.flags & BOARD_PLACED)
    machine.senses = bool(board.flags & BOARD_SENSES)
    machine.operator = bool(board.flags & BOARD_OPERATOR)
    machine.fence_unreadable = bool(board.flags & BOARD_FENCE_LOST)
    machine.goal = goal_of(board)


def goal_of(board: BoardState) -> Goal | None:
    """Return the goal; its tolerances stay on the board."""
    if isnan(board.goal_x_m):
        return None
    heading_rad = None if isnan(board.goal_heading_rad) else board.goal_heading_rad
    return Goal(board.goal_x_m, board.goal_y_m, heading_rad, 0.0, 0.0)


def copy_odometry(state: State, message: PlanarOdometry) -> None:
    """Copy speeds, and the covariance while the place is known."""
    odometry = state.odometry
    odometry.speed_m_s, odometry.yaw_rate_rad_s = message.speed_m_s, message.yaw_rate_rad_s
    if isnan(message.cov_xx_m2):
        return
    odometry.pxx, odometry.pxy, odometry.pxh = (
        message.cov_xx_m2,
        message.cov_xy_m2,
        message.cov_xh_m_rad,
    )
    odometry.pyy, odometry.pyh, odometry.phh = (
        message.cov_yy_m2,
        message.cov_yh_m_rad,
        message.cov_hh_rad2,
    )


def decision_of(message: AvoidanceDecision) -> Decision | None:
    """Return the decision in a message, or None if nothing was decided.

    The message has no speed limit: it is nan.
    """
    if message.branch == states.NO_BRANCH:
        return None
    bearing_rad = message.nearest_bearing_rad
    return Decision(
        message.branch,
        None if isnan(bearing_rad) else bearing_rad,
        message.nearest_range_m,
        message.goal_bearing_rad,
        message.rotation_rad,
        message.virtual_x_m,
        message.virtual_y_m,
        nan,
    )
