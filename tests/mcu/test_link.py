"""Garbage, damaged and foreign frames on the serial line."""

from random import Random

import pytest

from firmware.board import Board
from protocol.wire.codec import Encoder
from protocol.wire.enums import BOARD_SENSES
from protocol.wire.messages import Heartbeat
from robot.core import states
from robot.core.parameters import DEFAULTS
from tests.mcu.rolling import inputs_at, scan_at, tick, wheels_at

pytestmark = pytest.mark.mcu


@pytest.mark.parametrize("seed", range(3))
def test_board_skips_and_counts_garbage(seed: int, board: Board) -> None:
    board.set_up(DEFAULTS)
    random, sent = Random(seed), 0
    for number in range(1, 21):
        garbage = bytes(random.choices([0xFD, random.randrange(256)], k=random.randrange(90)))
        board.write(garbage)
        sent += len(garbage)
        outputs = tick(board, number)
        assert outputs.state.flags & BOARD_SENSES
    assert outputs.report.skipped_bytes == sent
    assert outputs.state.vehicle == states.STANDBY


def test_damaged_frame_counts_as_missing_sample(board: Board) -> None:
    board.set_up(DEFAULTS)
    tick(board, 1)
    frame = bytearray(Encoder(1, 1).encode(wheels_at(2)))
    frame[15] ^= 1
    board.write(bytes(frame))
    outputs = board.tick(inputs_at(2), None, scan_at(2))
    assert outputs.report.refused == 1
    assert outputs.report.skipped_bytes == len(frame)
    assert not outputs.state.flags & BOARD_SENSES


def test_frame_behind_a_truncated_one_is_found(board: Board) -> None:
    board.set_up(DEFAULTS)
    frame = Encoder(1, 1).encode(scan_at(1))
    board.write(frame[:-7])
    outputs = tick(board, 1)
    assert outputs.state.flags & BOARD_SENSES
    assert outputs.report.skipped_bytes == len(frame) - 7


def test_unknown_message_is_skipped(board: Board) -> None:
    board.set_up(DEFAULTS)
    beat = Heartbeat(type=6, autopilot=8, base_mode=0, custom_mode=0, system_status=4)
    frame = Encoder(255, 190).encode(beat)
    board.write(frame)
    assert tick(board, 1).report.skipped_bytes == len(frame)


def test_tick_before_the_set_up_is_ignored(board: Board) -> None:
    board.send(inputs_at(1))
    board.set_up(DEFAULTS)
    assert tick(board, 1).report.tick == 1
