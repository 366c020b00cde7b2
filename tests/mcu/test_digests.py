"""A trial with the core on the board gives the trajectory of CPython, to the last bit.

Each tick and the memory are within the ceilings as well. A drive begins near an obstacle and ends
soon after it has met it, but that of the usual navigator, and every one with `--examples long`,
goes on to the goal.
"""

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Final

import pytest

from checks.speed.board.measure import build, counted, report_of, summary
from checks.speed.board.results import Build, excesses
from firmware.board import Board
from firmware.host import BoardCore
from plant.sim.simulation import Plant
from plant.world.file import load
from protocol.wire.messages import BoardReport
from protocol.world import Start
from robot.core.values import Outputs
from study.cli.trial import elsewhere
from study.trial.core_loop import CoreLoop
from study.trial.trial import NAVIGATORS, USUAL_NAVIGATOR, Trial, run_trial

pytestmark = pytest.mark.mcu

SHORT_S: Final = 6.0
LONG_S: Final = 120.0
NEAR: Final = Start(x_m=1.8, y_m=2.0, heading_rad=0.0)
"""In the world `disc`, 0.8 m before the obstacle."""

Step = tuple[int, int, int, float, float, float]


class Steps:
    """Wheel commands and estimated poses, tick by tick; and what the board reports of itself."""

    def __init__(self) -> None:
        self.steps: list[Step] = []
        self.reports: list[BoardReport] = []

    def __call__(self, plant: Plant, onboard: CoreLoop, outputs: Outputs) -> None:
        """Note one tick."""
        left, right, guard = outputs.left_mrad_s, outputs.right_mrad_s, outputs.guard
        self.steps.append((left, right, guard, *onboard.state.odometry.pose))
        if isinstance(onboard.core, BoardCore):
            self.reports.append(report_of(onboard.core))


@pytest.fixture
def limit_s(request: pytest.FixtureRequest) -> float:
    """Return the simulated time after which a drive ends."""
    return LONG_S if request.config.getoption("--examples") == "long" else SHORT_S


@pytest.fixture(scope="module")
def made(firmware: Path) -> Build:
    """Return the sizes that a board with the image reports."""
    return build()


@pytest.mark.parametrize("navigator", NAVIGATORS)
def test_board_drives_as_cpython_within_its_ceilings(
    navigator: str, made: Build, firmware: Path, limit_s: float
) -> None:
    world = elsewhere(load("disc"), NEAR, None, 0.0)
    until_s = LONG_S if navigator == USUAL_NAVIGATOR else limit_s
    trial = Trial(world=world, navigator=navigator, seed=3, timeout_s=until_s, moved=True)
    with counted(firmware) as found:
        reports = assert_equal(trial, found.board)
    cost = summary(navigator, "disc", True, reports, found)
    assert cost.ticks > 100
    assert cost.whole_instructions > cost.command_instructions > 100_000
    assert excesses(made, cost) == []


def test_board_drives_as_cpython_without_noise(board: Board, limit_s: float) -> None:
    assert_equal(Trial(world=load("paper_fig7"), noise="none", timeout_s=limit_s), board)


def test_board_keeps_every_bit_of_parameters_and_start(board: Board, limit_s: float) -> None:
    """Drive; then without these parameters on the same board, which was restarted."""
    parameters = {"k_rho": 2.9 + 1e-15, "accel_m_s2": 1.0 / 0.7}
    trial = Trial(world=load("open"), parameters=parameters, timeout_s=limit_s)
    assert_equal(trial, board)
    board.restart()
    assert_equal(replace(trial, parameters={}), board)


def assert_equal(trial: Trial, board: Board) -> list[BoardReport]:
    """Run a trial in this process and on the board; compare every tick, return its reports."""
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
    return theirs.reports
