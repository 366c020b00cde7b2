"""A trial with the core on the board gives the trajectory of CPython, to the last bit."""

from functools import partial
from pathlib import Path

import pytest

from plant.sim.simulation import Plant
from plant.world.file import load
from robot.core.values import Outputs
from robot.hosting.on_board import BoardCore
from robot.mcu.board import Board
from study.trial.core_loop import CoreLoop
from study.trial.trial import NAVIGATORS, USUAL_NAVIGATOR, Trial, run_trial

pytestmark = pytest.mark.mcu

Step = tuple[int, int, int, float, float, float]


class Steps:
    """Wheel commands and estimated poses, tick by tick."""

    def __init__(self) -> None:
        self.steps: list[Step] = []

    def __call__(self, plant: Plant, onboard: CoreLoop, outputs: Outputs) -> None:
        """Note one tick."""
        left, right, guard = outputs.left_mrad_s, outputs.right_mrad_s, outputs.guard
        self.steps.append((left, right, guard, *onboard.state.odometry.pose))


@pytest.mark.parametrize("navigator", NAVIGATORS)
def test_board_drives_as_cpython_to_the_last_bit(navigator: str, board: Board) -> None:
    assert_equal(Trial(world=load("disc"), navigator=navigator, seed=3), board)


def test_board_drives_as_cpython_without_noise(board: Board) -> None:
    assert_equal(Trial(world=load("paper_fig7"), noise="none"), board)


def test_board_keeps_every_bit_of_parameters_and_start(board: Board) -> None:
    parameters = {"k_rho": 2.9 + 1e-15, "accel_m_s2": 1.0 / 0.7}
    assert_equal(Trial(world=load("open"), parameters=parameters), board)


def test_board_can_be_set_up_again(firmware: Path) -> None:
    trial = Trial(world=load("open"), navigator=USUAL_NAVIGATOR)
    with Board.emulated(firmware) as board:
        first = run_trial(trial, new_core=partial(BoardCore, board))
        board.restart()
        assert run_trial(trial, new_core=partial(BoardCore, board)).digest == first.digest


def assert_equal(trial: Trial, board: Board) -> None:
    """Run a trial in this process and on the board; compare every tick."""
    ours, theirs = Steps(), Steps()
    expected = run_trial(trial, ours)
    found = run_trial(trial, theirs, partial(BoardCore, board))
    pairs = enumerate(zip(ours.steps, theirs.steps, strict=False))
    differing = next(((tick, *pair) for tick, pair in pairs if pair[0] != pair[1]), None)
    assert differing is None
    assert len(theirs.steps) == len(ours.steps)
    assert found.digest == expected.digest
    assert (found.outcome, found.time_s) == (expected.outcome, expected.time_s)
    assert found.estimated_position_error_m == expected.estimated_position_error_m
