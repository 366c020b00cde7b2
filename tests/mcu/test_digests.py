"""A trial with the core on the board gives the trajectory of CPython, to the last bit.

A drive ends soon after it has met an obstacle; with `--examples long` it goes on to the goal.
"""

from dataclasses import replace
from functools import partial
from typing import Final

import pytest

from plant.sim.simulation import Plant
from plant.world.file import load
from robot.core.values import Outputs
from robot.hosting.on_board import BoardCore
from robot.mcu.board import Board
from study.trial.core_loop import CoreLoop
from study.trial.trial import NAVIGATORS, Trial, run_trial

pytestmark = pytest.mark.mcu

SHORT_S: Final = 12.0
LONG_S: Final = 120.0

Step = tuple[int, int, int, float, float, float]


class Steps:
    """Wheel commands and estimated poses, tick by tick."""

    def __init__(self) -> None:
        self.steps: list[Step] = []

    def __call__(self, plant: Plant, onboard: CoreLoop, outputs: Outputs) -> None:
        """Note one tick."""
        left, right, guard = outputs.left_mrad_s, outputs.right_mrad_s, outputs.guard
        self.steps.append((left, right, guard, *onboard.state.odometry.pose))


@pytest.fixture
def limit_s(request: pytest.FixtureRequest) -> float:
    """Return the simulated time after which a drive ends."""
    return LONG_S if request.config.getoption("--examples") == "long" else SHORT_S


@pytest.mark.parametrize("navigator", NAVIGATORS)
def test_board_drives_as_cpython_to_the_last_bit(
    navigator: str, board: Board, limit_s: float
) -> None:
    assert_equal(Trial(world=load("disc"), navigator=navigator, seed=3, timeout_s=limit_s), board)


def test_board_drives_as_cpython_without_noise(board: Board, limit_s: float) -> None:
    assert_equal(Trial(world=load("paper_fig7"), noise="none", timeout_s=limit_s), board)


def test_board_keeps_every_bit_of_parameters_and_start(board: Board) -> None:
    """Drive to the goal; then without these parameters on the same board, which was restarted."""
    parameters = {"k_rho": 2.9 + 1e-15, "accel_m_s2": 1.0 / 0.7}
    trial = Trial(world=load("open"), parameters=parameters)
    assert_equal(trial, board)
    board.restart()
    assert_equal(replace(trial, parameters={}, timeout_s=SHORT_S), board)


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
