"""A silent host, a board that restarts or hangs, and images that cannot be used."""

from pathlib import Path
from time import monotonic

import pytest

from checks.faults.breakable_board import hang
from firmware.board import RESTART, Board, BoardError, BoardMismatchError, Emulator
from firmware.image import core_hash
from protocol.wire.enums import ResetCause
from protocol.wire.message import Message
from protocol.wire.messages import BoardRestart, BoardState, WheelCommand
from robot.core import reasons, states
from robot.core.parameters import DEFAULTS
from runtime.errors import UserError
from tests.mcu.rolling import drive_off, tick

pytestmark = pytest.mark.mcu

PATIENCE_S = 60.0
SILENCE_MS = 3000
"""A busy machine may stop this process for a moment between two messages to the board."""


def arrived(board: Board, kind: type[Message]) -> Message:
    """Wait for a message that the board sends of itself."""
    deadline = monotonic() + PATIENCE_S
    while monotonic() < deadline:
        for message in board.poll(wait_s=1.0):
            if isinstance(message, kind):
                return message
    raise AssertionError(f"no {kind.__name__} within {PATIENCE_S} s")


def test_board_stops_the_wheels_when_the_host_is_silent(board: Board) -> None:
    board.set_up(DEFAULTS, silence_ms=SILENCE_MS)
    drive_off(board)
    state = arrived(board, BoardState)
    assert isinstance(state, BoardState)
    assert (state.vehicle, state.vehicle_reason) == (states.FAILSAFE, reasons.TICKS_LOST)
    command = arrived(board, WheelCommand)
    assert isinstance(command, WheelCommand)
    assert (command.left_mrad_s, command.right_mrad_s) == (0, 0)


def test_board_stays_stopped_when_the_host_is_back(board: Board) -> None:
    board.set_up(DEFAULTS, silence_ms=SILENCE_MS)
    last = drive_off(board)
    arrived(board, BoardState)
    board.poll(wait_s=1.0)
    outputs = tick(board, last + 1)
    assert outputs.state.vehicle == states.FAILSAFE
    assert (outputs.command.left_mrad_s, outputs.command.right_mrad_s) == (0, 0)
    assert outputs.report.silences == 1


def test_restart_is_reported_to_a_waiting_host(board: Board) -> None:
    board.set_up(DEFAULTS)
    last = drive_off(board)
    board.send(BoardRestart(confirmation=RESTART))
    with pytest.raises(BoardError, match=r"restarted \(cause: external\)"):
        tick(board, last + 1)
    assert board.hello.reset_cause == ResetCause.EXTERNAL


def test_hanging_board_is_reset_by_its_watchdog(firmware: Path, tmp_path: Path) -> None:
    socket = tmp_path / "gdb"
    extra = ("-chardev", f"socket,id=gdb,path={socket},server=on,wait=off", "-gdb", "chardev:gdb")
    with Emulator(firmware, extra=extra) as emulator:
        board = Board(emulator.line)
        board.wait_for_hello()
        board.set_up(DEFAULTS)
        last = drive_off(board)
        hang(socket)
        with pytest.raises(BoardError, match=r"restarted \(cause: watchdog\)"):
            tick(board, last + 1)
        assert board.hello.reset_cause == ResetCause.WATCHDOG


def test_dead_emulator_is_reported(firmware: Path) -> None:
    with Emulator(firmware) as emulator:
        board = Board(emulator.line)
        board.wait_for_hello()
        emulator.kill()
        with pytest.raises(BoardError, match="the line to the board is cut"):
            board.set_up(DEFAULTS)


def test_image_of_another_core_is_refused(firmware: Path, tmp_path: Path) -> None:
    other = tmp_path / "firmware.elf"
    wrong = bytes(byte ^ 0xFF for byte in core_hash())
    image = firmware.read_bytes()
    assert image.count(core_hash()) == 1
    other.write_bytes(image.replace(core_hash(), wrong))
    with pytest.raises(BoardMismatchError) as refused, Board.emulated(other):
        pass
    assert wrong.hex()[:12] in str(refused.value)
    assert core_hash().hex()[:12] in str(refused.value)


def test_missing_image_is_named(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="make firmware"), Board.emulated(tmp_path / "none.elf"):
        pass


def test_damaged_image_is_named_with_the_words_of_the_emulator(
    firmware: Path, tmp_path: Path
) -> None:
    damaged = tmp_path / "firmware.elf"
    damaged.write_bytes(bytes(firmware.stat().st_size))
    with (
        pytest.raises(UserError, match=r"cannot be run: .*`make firmware` \(qemu: ") as refused,
        Board.emulated(damaged),
    ):
        pass
    assert str(damaged) in str(refused.value)
    assert refused.value.exit_code == 2
