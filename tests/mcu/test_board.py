"""A board: requests, garbage on its line, restarts, memory, and the commands of the guide."""

import os
import re
import subprocess
import sys
from math import inf, nan
from pathlib import Path
from random import Random
from time import monotonic
from typing import Final

import pytest

from checks.faults.simulated_time import hang
from firmware.board import PARAMETERS, RESTART, Board, BoardError, BoardMismatchError, Emulator
from firmware.image import IMAGE, core_hash
from protocol.wire.codec import Encoder
from protocol.wire.enums import BOARD_SENSES, Command, Mode, ResetCause
from protocol.wire.message import Message
from protocol.wire.messages import (
    BoardFence,
    BoardParameter,
    BoardRestart,
    BoardState,
    Heartbeat,
    WheelCommand,
)
from robot.core import reasons, states
from robot.core.parameters import DEFAULTS
from runtime.errors import UserError
from tests.mcu.rolling import command, drive_off, goal_at, inputs_at, scan_at, tick, wheels_at


@pytest.mark.mcu
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


@pytest.mark.mcu
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


@pytest.mark.mcu
def test_frame_behind_a_truncated_one_is_found(board: Board) -> None:
    board.set_up(DEFAULTS)
    frame = Encoder(1, 1).encode(scan_at(1))
    board.write(frame[:-7])
    outputs = tick(board, 1)
    assert outputs.state.flags & BOARD_SENSES
    assert outputs.report.skipped_bytes == len(frame) - 7


@pytest.mark.mcu
def test_unknown_message_is_skipped(board: Board) -> None:
    board.set_up(DEFAULTS)
    beat = Heartbeat(type=6, autopilot=8, base_mode=0, custom_mode=0, system_status=4)
    frame = Encoder(255, 190).encode(beat)
    board.write(frame)
    assert tick(board, 1).report.skipped_bytes == len(frame)


@pytest.mark.mcu
def test_tick_before_the_set_up_is_ignored(board: Board) -> None:
    board.send(inputs_at(1))
    board.set_up(DEFAULTS)
    assert tick(board, 1).report.tick == 1


CORNERS = [(-100_000, -100_000), (600_000, -100_000), (600_000, 100_000), (-100_000, 100_000)]


def fence(corners: list[tuple[int, int]], exclusion: int = 0) -> BoardFence:
    """Return a polygon."""
    padded = corners + [(0, 0)] * (16 - len(corners))
    xs, ys = zip(*padded, strict=True)
    return BoardFence(radius_m=0.0, x=xs, y=ys, corners=len(corners), exclusion=exclusion)


@pytest.mark.mcu
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


@pytest.mark.mcu
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


@pytest.mark.mcu
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


@pytest.mark.mcu
@pytest.mark.parametrize("value", [nan, inf, 1e12, 0.5])
def test_parameter_that_does_not_fit_is_refused(value: float, board: Board) -> None:
    request = BoardParameter(index=PARAMETERS.index("stuck_ms"), value=value)
    assert board.request(request) == reasons.PARAMETER_OUT_OF_RANGE


@pytest.mark.mcu
def test_unknown_parameter_is_refused(board: Board) -> None:
    request = BoardParameter(index=len(PARAMETERS), value=1.0)
    assert board.request(request) == reasons.UNKNOWN_PARAMETER


@pytest.mark.mcu
def test_requests_before_the_set_up_are_refused(board: Board) -> None:
    assert board.request(goal_at(1000)) == reasons.NO_SENSES
    assert board.request(command(Command.DO_FLIGHTTERMINATION)) == reasons.NO_SENSES


@pytest.mark.mcu
def test_fence_is_checked_on_the_board(board: Board) -> None:
    board.set_up(DEFAULTS)
    tick(board, 1)
    assert board.request(fence([CORNERS[0], CORNERS[2], CORNERS[1], CORNERS[3]])) == (
        reasons.FENCE_NOT_SIMPLE
    )
    assert board.request(fence(CORNERS)) == reasons.OK
    assert board.request(command(Command.COMPONENT_ARM_DISARM, 1.0)) == reasons.OK
    assert board.request(goal_at(61_000)) == reasons.OUTSIDE_FENCE
    hole = [(200_000, -50_000), (300_000, -50_000), (300_000, 50_000)]
    assert board.request(fence(hole, exclusion=1)) == reasons.OK
    assert board.request(goal_at(28_000)) == reasons.OUTSIDE_FENCE
    assert board.request(fence(CORNERS)) == reasons.OK
    assert board.request(goal_at(28_000)) == reasons.OK
    assert board.request(fence([])) == reasons.OK
    assert board.request(goal_at(61_000)) == reasons.OK


@pytest.mark.mcu
def test_lost_fence_forbids_arming(board: Board) -> None:
    board.set_up(DEFAULTS, fence_lost=True)
    tick(board, 1)
    arm = command(Command.COMPONENT_ARM_DISARM, 1.0)
    assert board.request(arm) == reasons.FENCE_UNREADABLE


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


@pytest.mark.mcu
def test_board_stops_the_wheels_when_the_host_is_silent(board: Board) -> None:
    board.set_up(DEFAULTS, silence_ms=SILENCE_MS)
    drive_off(board)
    state = arrived(board, BoardState)
    assert isinstance(state, BoardState)
    assert (state.vehicle, state.vehicle_reason) == (states.FAILSAFE, reasons.TICKS_LOST)
    command = arrived(board, WheelCommand)
    assert isinstance(command, WheelCommand)
    assert (command.left_mrad_s, command.right_mrad_s) == (0, 0)


@pytest.mark.mcu
def test_board_stays_stopped_when_the_host_is_back(board: Board) -> None:
    board.set_up(DEFAULTS, silence_ms=SILENCE_MS)
    last = drive_off(board)
    arrived(board, BoardState)
    board.poll(wait_s=1.0)
    outputs = tick(board, last + 1)
    assert outputs.state.vehicle == states.FAILSAFE
    assert (outputs.command.left_mrad_s, outputs.command.right_mrad_s) == (0, 0)
    assert outputs.report.silences == 1


@pytest.mark.mcu
def test_restart_is_reported_to_a_waiting_host(board: Board) -> None:
    board.set_up(DEFAULTS)
    last = drive_off(board)
    board.send(BoardRestart(confirmation=RESTART))
    with pytest.raises(BoardError, match=r"restarted \(cause: external\)"):
        tick(board, last + 1)
    assert board.hello.reset_cause == ResetCause.EXTERNAL


@pytest.mark.mcu
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


@pytest.mark.mcu
def test_dead_emulator_is_reported(firmware: Path) -> None:
    with Emulator(firmware) as emulator:
        board = Board(emulator.line)
        board.wait_for_hello()
        emulator.kill()
        with pytest.raises(BoardError, match="the line to the board is cut"):
            board.set_up(DEFAULTS)


@pytest.mark.mcu
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


@pytest.mark.mcu
def test_missing_image_is_named(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="make firmware"), Board.emulated(tmp_path / "none.elf"):
        pass


@pytest.mark.mcu
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


TICKS = 100
TRAIL_BYTES = 1024
"""What the trail of the drive may take in these ticks."""


@pytest.mark.mcu
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


STRAY: Final = 512
"""Bytes that a stray word on the stack may hold; a core has more than 8 KB."""


@pytest.mark.mcu
def test_set_up_again_frees_the_core_before(board: Board) -> None:
    live = []
    for _ in range(5):
        board.set_up(DEFAULTS)
        last = drive_off(board)
        live.append([tick(board, last + i).report.heap_live_bytes for i in range(1, 4)][-1])
    # The collector takes each word on the stack for a reference, so that any count, the first, too,
    # may hold a small block that nothing uses. A core that stays has kilobytes, each time.
    assert max(live) <= min(live) + STRAY


ROOT: Final = Path(__file__).resolve().parents[2]
DIGEST: Final = re.compile(r"^ *digest +([0-9a-f]{64})$", re.MULTILINE)
WITHIN_S: Final = 240.0
DRIVE: Final = ("--world", "open", "--goal", "2", "2")


def sidestep(*words: str, folder: Path) -> "subprocess.CompletedProcess[str]":
    """Run a verb in another folder."""
    environment = os.environ | {"PYTHONPATH": str(ROOT), "HOME": str(folder)}
    return subprocess.run(
        [sys.executable, "-m", "sidestep", *words],
        cwd=folder, env=environment, timeout=WITHIN_S, text=True, capture_output=True, check=False,
    )  # fmt: skip


def digest_of(ended: "subprocess.CompletedProcess[str]") -> str:
    assert ended.returncode == 0, ended.stdout + ended.stderr
    found = DIGEST.findall(ended.stdout)
    assert len(found) == 1, ended.stdout
    return str(found[0])


@pytest.mark.mcu
@pytest.mark.usefixtures("firmware")
def test_drives_on_the_board_print_the_digest_of_a_trial(tmp_path: Path) -> None:
    trial = digest_of(sidestep("trial", *DRIVE, folder=tmp_path))
    on_board = digest_of(sidestep("trial", "--mcu", *DRIVE, folder=tmp_path))
    words = ("up", "--mcu", "--headless", "--no-record", "--speed", "20", *DRIVE)
    stack = digest_of(sidestep(*words, folder=tmp_path))
    assert on_board == stack == trial
