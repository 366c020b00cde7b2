"""A board that fails ends the robot as an exception of the core does, with a clear text."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from firmware.board import RESTART, Board, BoardError, BoardMismatchError
from firmware.host import WALL_TIME, BoardCore
from firmware.image import core_hash, core_version
from protocol.wire.enums import Command
from protocol.wire.messages import BoardRestart, CommandRequest
from robot.core import reasons, states
from robot.core.brain import ignore
from robot.core.parameters import DEFAULTS, Params
from robot.core.values import Inputs, Scan, Wheels
from robot.storage import Store
from robot.vehicle import Vehicle
from runtime.errors import UserError
from tests.support.each import each
from tests.support.robot.mcu.hosted import Hosted, hosted_board

OPEN_SPACE = Scan((0,) * 8, (25, 0) * 4, 0xFF, 0)
ARM = CommandRequest(request_id=1, param1=1.0, param2=0.0, command=Command.COMPONENT_ARM_DISARM)


@contextmanager
def driving(patience_s: float = 2.0) -> Iterator[tuple[Vehicle, Board, Hosted]]:
    """Return an armed robot on its way, with its board."""
    with hosted_board() as (board, hosted):
        vehicle = Vehicle(DEFAULTS, Store(None), new_core=lambda *given: BoardCore(board, *given))
        tick(vehicle, 1)
        assert vehicle.core.command(ARM, 0) == reasons.OK
        board.patience_s = patience_s
        yield vehicle, board, hosted


def tick(vehicle: Vehicle, number: int) -> None:
    wheels = Wheels(0, 0, 0, 50 * number)
    vehicle.step(Inputs(50 * number, wheels, OPEN_SPACE, 0), ignore)


def fails(vehicle: Vehicle, words: str) -> None:
    """Require the next tick to fail with these words, and the vehicle to be stopped."""
    assert vehicle.state.machine.vehicle == states.ACTIVE
    with pytest.raises(BoardError, match=words):
        tick(vehicle, 2)
    machine = vehicle.state.machine
    assert (machine.vehicle, machine.vehicle_reason) == (states.FAILSAFE, reasons.CORE_EXCEPTION)
    assert vehicle.brakes


def test_board_that_hangs_stops_the_robot_within_the_limit() -> None:
    with driving(patience_s=0.3) as (vehicle, _, hosted):
        hosted.suspend()
        fails(vehicle, "the board hangs or its line is stuck: no answer for 0.3 s")


def test_board_that_ends_stops_the_robot_at_once() -> None:
    with driving() as (vehicle, _, hosted):
        hosted.kill()
        fails(vehicle, "the line to the board is (cut|broken)")


def test_board_that_restarts_stops_the_robot_and_names_the_cause() -> None:
    with driving(patience_s=20.0) as (vehicle, board, _):
        board.send(BoardRestart(confirmation=RESTART))
        fails(vehicle, "the board has restarted .cause: external.")


def test_restart_without_its_confirmation_is_ignored() -> None:
    with driving(patience_s=20.0) as (vehicle, board, _):
        board.send(BoardRestart(confirmation=RESTART + 1))
        tick(vehicle, 2)
        assert vehicle.state.machine.vehicle == states.ACTIVE


def test_garbage_on_the_line_changes_nothing() -> None:
    with driving(patience_s=20.0) as (vehicle, board, _):
        for number in range(2, 40):
            board.write(os.urandom(50) + b"\xfd\xff\x00")
            tick(vehicle, number)
        status = vehicle.core.board_status(0)
        assert status is not None
        assert status.skipped_bytes >= 38 * 50
        assert vehicle.state.machine.vehicle == states.ACTIVE


def test_failed_board_also_fails_a_request() -> None:
    with driving(patience_s=0.3) as (vehicle, _, hosted):
        hosted.suspend()
        with pytest.raises(BoardError, match="hangs"):
            vehicle.receive(ARM, 0)


def test_vehicle_stops_for_a_reason_without_its_board() -> None:
    with driving(patience_s=0.3) as (vehicle, _, hosted):
        hosted.kill()
        vehicle.stop(reasons.CORE_EXCEPTION, 60)
        machine = vehicle.state.machine
        assert (machine.vehicle, machine.vehicle_reason) == (
            states.FAILSAFE,
            reasons.CORE_EXCEPTION,
        )
        assert vehicle.brakes


def test_late_answer_in_wall_time_is_a_missed_deadline() -> None:
    with driving(patience_s=WALL_TIME.answer_s) as (vehicle, _, hosted):
        hosted.suspend()
        fails(vehicle, "no answer for 0.045 s")


def test_image_of_another_core_is_refused_by_name_and_hash() -> None:
    with (
        pytest.raises(BoardMismatchError) as refused,
        hosted_board(which="other-core"),
    ):
        pass
    for words in (core_version(), core_hash().hex()[:12], "000000000000", "make firmware"):
        assert words in str(refused.value)
    assert refused.value.exit_code == 2


@each(
    ("params", "name"),
    [
        (DEFAULTS._replace(stuck_ms=2**31), "stuck_ms"),
        (DEFAULTS._replace(goal_max_m=float("nan")), "goal_max_m"),
    ],
)
def test_parameter_that_does_not_fit_the_board_is_refused(params: Params, name: str) -> None:
    with (
        hosted_board() as (board, _),
        pytest.raises(UserError, match=f"the board refuses {name}: "),
    ):
        BoardCore(board, params)


def test_refused_parameters_leave_the_others_as_they_were() -> None:
    with hosted_board() as (board, _):
        core = BoardCore(board, DEFAULTS)
        changed = DEFAULTS._replace(goal_max_m=9.0, progress_ms=2**31)
        assert core.adopt(changed) == reasons.PARAMETER_OUT_OF_RANGE
        assert core.params == DEFAULTS
        assert core.state.machine.goal_max_m == DEFAULTS.goal_max_m
        assert core.adopt(DEFAULTS._replace(goal_max_m=9.0)) == reasons.OK
        assert core.params.goal_max_m == core.state.machine.goal_max_m == 9.0


def test_missing_emulator_is_a_clear_error(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", "")
    with pytest.raises(UserError, match="qemu-system-arm") as refused, Board.emulated():
        pass
    assert refused.value.exit_code == 2


def test_missing_image_is_a_clear_error(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr("firmware.board.shutil.which", lambda _: "/usr/bin/qemu")
    with pytest.raises(UserError, match="make firmware"), Board.emulated(tmp_path / "none.elf"):
        pass
