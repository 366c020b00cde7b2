"""Requests of the host, and their refusals."""

from math import inf, nan

import pytest

from firmware.board import PARAMETERS, Board
from protocol.wire.enums import Command, Mode
from protocol.wire.messages import BoardFence, BoardParameter
from robot.core import reasons, states
from robot.core.parameters import DEFAULTS
from tests.mcu.rolling import command, drive_off, goal_at, tick

pytestmark = pytest.mark.mcu

CORNERS = [(-100_000, -100_000), (600_000, -100_000), (600_000, 100_000), (-100_000, 100_000)]


def fence(corners: list[tuple[int, int]]) -> BoardFence:
    """Return a polygon."""
    padded = corners + [(0, 0)] * (16 - len(corners))
    xs, ys = zip(*padded, strict=True)
    return BoardFence(radius_m=0.0, x=xs, y=ys, corners=len(corners))


def test_emergency_stop_latches_until_it_is_cleared(board: Board) -> None:
    board.set_up(DEFAULTS)
    last = drive_off(board)
    assert board.request(command(Command.DO_FLIGHTTERMINATION)) == reasons.OK
    outputs = tick(board, last + 1)
    assert (outputs.command.left_mrad_s, outputs.command.right_mrad_s) == (0, 0)
    assert outputs.state.vehicle == states.EMERGENCY_STOP
    arm = command(Command.COMPONENT_ARM_DISARM, 1.0)
    assert board.request(arm) == reasons.EMERGENCY_STOPPED
    assert board.request(command(Command.SIDESTEP_CLEAR_EMERGENCY_STOP)) == reasons.OK
    assert board.request(arm) == reasons.OK


def test_hold_keeps_the_goal_and_resume_drives_on(board: Board) -> None:
    board.set_up(DEFAULTS)
    last = drive_off(board)
    assert board.request(command(Command.DO_PAUSE_CONTINUE, 0.0)) == reasons.OK
    assert board.state is not None
    assert (board.state.mode, board.state.resume_mode) == (Mode.HOLD, Mode.AUTO)
    assert board.request(command(Command.DO_PAUSE_CONTINUE, 1.0)) == reasons.OK
    assert tick(board, last + 1).state.goal == states.DRIVING
    assert board.request(command(Command.SIDESTEP_ABORT_GOAL)) == reasons.OK
    assert tick(board, last + 2).state.goal_reason == reasons.BY_OPERATOR


def test_navigator_can_be_changed_while_driving(board: Board) -> None:
    board.set_up(DEFAULTS)
    last = drive_off(board)
    for number in (states.BUG, states.BUG1, states.BUG2, states.DISTBUG, states.VGM):
        last += 1
        assert board.request(command(Command.SIDESTEP_SET_NAVIGATOR, number)) == reasons.OK
        outputs = tick(board, last)
        assert outputs.state.navigator == number
        assert outputs.command.left_mrad_s > 0
    unknown = command(Command.SIDESTEP_SET_NAVIGATOR, 77.0)
    assert board.request(unknown) == reasons.UNKNOWN_NAVIGATOR


@pytest.mark.parametrize("value", [nan, inf, 1e12, 0.5])
def test_parameter_that_does_not_fit_is_refused(value: float, board: Board) -> None:
    request = BoardParameter(index=PARAMETERS.index("stuck_ms"), value=value)
    assert board.request(request) == reasons.PARAMETER_OUT_OF_RANGE


def test_unknown_parameter_is_refused(board: Board) -> None:
    request = BoardParameter(index=len(PARAMETERS), value=1.0)
    assert board.request(request) == reasons.UNKNOWN_PARAMETER


def test_requests_before_the_set_up_are_refused(board: Board) -> None:
    assert board.request(goal_at(1000)) == reasons.NO_SENSES
    assert board.request(command(Command.DO_FLIGHTTERMINATION)) == reasons.NO_SENSES


def test_fence_is_checked_on_the_board(board: Board) -> None:
    board.set_up(DEFAULTS)
    tick(board, 1)
    assert board.request(fence([CORNERS[0], CORNERS[2], CORNERS[1], CORNERS[3]])) == (
        reasons.FENCE_NOT_SIMPLE
    )
    assert board.request(fence(CORNERS)) == reasons.OK
    assert board.request(command(Command.COMPONENT_ARM_DISARM, 1.0)) == reasons.OK
    assert board.request(goal_at(61_000)) == reasons.OUTSIDE_FENCE
    assert board.request(fence([])) == reasons.OK
    assert board.request(goal_at(61_000)) == reasons.OK


def test_lost_fence_forbids_arming(board: Board) -> None:
    board.set_up(DEFAULTS, fence_lost=True)
    tick(board, 1)
    arm = command(Command.COMPONENT_ARM_DISARM, 1.0)
    assert board.request(arm) == reasons.FENCE_UNREADABLE
