"""The heap of the board: what the program keeps, and what a tick leaves behind."""

import pytest

from firmware.board import Board
from firmware.image import IMAGE
from robot.core.parameters import DEFAULTS
from tests.mcu.rolling import drive_off, tick

pytestmark = pytest.mark.mcu

TICKS = 100
TRAIL_BYTES = 1024
"""What the trail of the drive may take in these ticks."""


def test_garbage_of_a_tick_is_collected(board: Board) -> None:
    board.set_up(DEFAULTS)
    last = drive_off(board)
    for number in range(last + 1, last + TICKS):
        first = tick(board, number).report
    for number in range(last + TICKS, last + 3 * TICKS):
        report = tick(board, number).report
        assert report.allocated_bytes > 0
    assert TICKS * report.allocated_bytes > IMAGE.heap_bytes
    assert report.heap_live_bytes <= first.heap_live_bytes + TRAIL_BYTES
    assert report.heap_peak_bytes <= IMAGE.heap_bytes


def test_set_up_again_frees_the_core_before(board: Board) -> None:
    live = []
    for _ in range(5):
        board.set_up(DEFAULTS)
        last = drive_off(board)
        live.append([tick(board, last + i).report.heap_live_bytes for i in range(1, 4)][-1])
    assert max(live[1:]) <= live[0] + 16
