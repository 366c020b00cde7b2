"""Inputs of a board that drives straight on in the open."""

from math import nan

from checks.harness.messages import make
from firmware.board import Board, BoardOutputs
from protocol.wire.enums import INPUT_SCAN, INPUT_WHEELS, Command, Mode
from protocol.wire.limits import NEVER_MS
from protocol.wire.messages import (
    BoardCommand,
    BoardGoal,
    SonarScan,
    TickInputs,
    WheelTicks,
)
from robot.core import reasons
from runtime.units import NS_PER_MS, PERIOD_NS

TICKS_PER_PERIOD = 60


def wheels_at(tick: int) -> WheelTicks:
    """Return the wheel ticks of a tick."""
    rolled = TICKS_PER_PERIOD * (tick - 1)
    return make(WheelTicks, time_ns=tick * PERIOD_NS, seq=tick, left=rolled, right=rolled)


def scan_at(tick: int) -> SonarScan:
    """Return a scan without echoes."""
    return make(SonarScan, time_ns=tick * PERIOD_NS, seq=tick, ping_age_us=(1000,) * 8)


def inputs_at(tick: int) -> TickInputs:
    """Return the other inputs of a tick."""
    return make(
        TickInputs,
        time_ns=tick * PERIOD_NS,
        now_ms=tick * PERIOD_NS // NS_PER_MS,
        tick=tick,
        wheels_seq=tick,
        scan_seq=tick,
        operator_age_ms=NEVER_MS,
        flags=INPUT_WHEELS | INPUT_SCAN,
    )


def tick(board: Board, number: int) -> BoardOutputs:
    """Run one tick with all inputs."""
    return board.tick(inputs_at(number), wheels_at(number), scan_at(number))


def command(number: Command, param1: float = 0.0, param2: float = 0.0) -> BoardCommand:
    """Return a command."""
    return BoardCommand(now_ms=0, param1=param1, param2=param2, param3=0.0, command=number)


def goal_at(x_mm: int) -> BoardGoal:
    """Return a goal straight ahead."""
    return make(
        BoardGoal,
        x_m=x_mm / 1000.0,
        heading_rad=nan,
        position_tolerance_m=0.1,
        heading_tolerance_rad=0.1,
        mode=Mode.AUTO,
    )


def drive_off(board: Board) -> int:
    """Arm, set a goal and run until the wheels turn; return the number of the last tick."""
    tick(board, 1)
    assert board.request(command(Command.COMPONENT_ARM_DISARM, 1.0)) == reasons.OK
    assert board.request(goal_at(50_000)) == reasons.OK
    assert tick(board, 2).command.left_mrad_s > 0
    return 2
