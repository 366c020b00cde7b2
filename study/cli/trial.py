"""`sidestep trial`: run one trial in this process, as fast as the machine allows."""

import argparse
import json
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from math import radians
from typing import Final, TextIO

from plant.model.noise import LEVELS
from plant.model.types import GoalPose, Start
from plant.placement.relocate import elsewhere
from plant.world.file import load
from protocol.options import (
    above_zero,
    add_param_option,
    finite,
    numbers_kept,
    up_to,
    whole,
)
from protocol.outcome import Outcome
from robot.hosting.core import NewCore
from robot.hosting.in_process import InProcessCore
from robot.parameters.table import OutOfRangeError, UnknownParameterError
from runtime.cli.parsers import new_parser
from runtime.errors import UserError
from study.oracle.names import STUDY_ONLY
from study.trial.trace import Trace
from study.trial.trial import (
    ALL_NAVIGATORS,
    SIDES,
    USUAL_NAVIGATOR,
    Trial,
    params_of,
    run_trial,
)

MAX_DURATION_S: Final = 24 * 3600.0
FULL_TURN_DEG: Final = 360.0
STANDARD_OUTPUT: Final = "-"
seconds: Final = above_zero(MAX_DURATION_S)
moment: Final = up_to(MAX_DURATION_S)


def main(argv: Sequence[str]) -> int:
    """Return 0 if the goal was reached, 1 if not, 2 for wrong usage (argparse).

    Raises WorldError or UserError for a configuration that cannot be used.
    """
    return trial(parser().parse_args(numbers_kept(argv)))


def trial(options: argparse.Namespace) -> int:
    """Run the trial that the options describe and print its outcome.

    Raises WorldError or UserError.
    """
    start, goal = start_of(options.start), goal_of(options)
    job = Trial(
        world=elsewhere(load(options.world), start, goal, options.at),
        navigator=options.navigator,
        side=options.side,
        seed=options.seed,
        noise=options.noise,
        timeout_s=options.timeout,
        parameters=dict(options.param),
        calibrated=not options.uncalibrated,
        at_s=options.at,
        moved=start is not None or goal is not None,
    )
    outcome = run_on_board(job, options.trace) if options.mcu else run(job, options.trace)
    print(json.dumps(outcome.as_json()) if options.json else outcome.text())
    return 0 if outcome.reached else 1


def run_on_board(job: Trial, trace: str | None) -> Outcome:
    """Run a trial with the core on the emulated board.

    Raises UserError if there is no emulator, or if the navigator is for studies only.
    """
    if job.navigator in STUDY_ONLY:
        raise UserError(
            f"--mcu: the navigator {job.navigator} is for studies only, not for a robot"
        )
    from robot.hosting.on_board import BoardCore  # needed only here
    from robot.mcu.board import Board

    with Board.emulated() as board:
        return run(job, trace, partial(BoardCore, board))


def run(job: Trial, trace: str | None, new_core: NewCore = InProcessCore) -> Outcome:
    """Run a trial and write its trace; raise UserError for a parameter or a file that fails."""
    try:
        params_of(job)  # reject bad parameters before a file is created
        if trace is None:
            return run_trial(job, new_core=new_core)
        with opened_trace(trace) as file:
            return run_trial(job, Trace(file), new_core)
    except (UnknownParameterError, OutOfRangeError) as error:
        raise UserError(f"--param or the world's [robot]: {error}") from None
    except OSError as error:
        raise UserError(f"--trace {trace}: cannot be opened: {error.strerror}") from None


@contextmanager
def opened_trace(trace: str) -> Iterator[TextIO]:
    """Open the trace file; `-` is standard output, where the outcome follows the trace."""
    if trace == STANDARD_OUTPUT:
        yield sys.stdout
        return
    with open(trace, "w", encoding="utf-8", newline="") as file:
        yield file


def start_of(numbers: list[float] | None) -> Start | None:
    """Return the start of `--start X Y DEG`."""
    if numbers is None:
        return None
    x_m, y_m, heading_deg = numbers
    return Start(x_m=x_m, y_m=y_m, heading_rad=turn("--start", heading_deg))


def goal_of(options: argparse.Namespace) -> GoalPose | None:
    """Return the goal of `--goal X Y [DEG]`; without DEG any heading is accepted.

    Raises UserError for another number of values or a heading out of range.
    """
    numbers: list[float] | None = options.goal
    if numbers is None:
        return None
    if len(numbers) not in (2, 3):
        raise UserError(f"--goal: give X Y or X Y DEG, not {len(numbers)} numbers")
    x_m, y_m, *heading = numbers
    heading_rad = turn("--goal", heading[0]) if heading else None
    return GoalPose(
        x_m=x_m,
        y_m=y_m,
        heading_rad=heading_rad,
        position_tolerance_m=options.tolerance,
        heading_tolerance_rad=radians(options.heading_tolerance),
    )


def turn(option: str, heading_deg: float) -> float:
    """Return a heading in radians; raise UserError outside one full turn."""
    if abs(heading_deg) > FULL_TURN_DEG:
        limits = f"{-FULL_TURN_DEG:g} to {FULL_TURN_DEG:g} deg"
        raise UserError(f"{option}: heading {heading_deg:g} deg is out of range: {limits}")
    return radians(heading_deg)


def parser() -> argparse.ArgumentParser:
    """Return the parser of the verb."""
    made = new_parser("trial", allow_abbrev=True)
    help = "name of a shipped world, or a .toml file (default box)"
    made.add_argument("--world", default="box", help=help)
    made.add_argument(
        "--navigator",
        choices=ALL_NAVIGATORS,
        default=USUAL_NAVIGATOR,
        help=f"(default {USUAL_NAVIGATOR})",
    )
    made.add_argument("--side", choices=SIDES, default="left", help="side to pass obstacles on")
    made.add_argument("--seed", type=whole(0), default=0, help="of the random numbers (default 0)")
    made.add_argument("--noise", choices=LEVELS, help="noise level (default that of the world)")
    _add_placement(made)
    made.add_argument(
        "--timeout",
        type=seconds,
        default=300.0,
        metavar="S",
        help="simulated time limit (default 300)",
    )
    add_param_option(made)
    made.add_argument(
        "--uncalibrated", action="store_true", help="do not calibrate the robot for the noise"
    )
    made.add_argument(
        "--mcu", action="store_true", help="run the control core on the emulated board"
    )
    text = (
        "write a CSV line per tick; - is stdout. With --mcu, pose and wheel speeds are exact, the"
        " other values of the robot have single precision, and speed_limit_m_s is not known (nan)"
    )
    made.add_argument("--trace", metavar="FILE", help=text)
    made.add_argument("--json", action="store_true", help="print one JSON object")
    return made


def _add_placement(made: argparse.ArgumentParser) -> None:
    made.add_argument("--start", type=finite, nargs=3, metavar=("X", "Y", "DEG"), help="start pose")
    made.add_argument(
        "--goal", type=finite, nargs="+", metavar="N", help="X Y [DEG] (default that of the world)"
    )
    made.add_argument(
        "--tolerance",
        type=above_zero(1.0),
        default=0.05,
        metavar="M",
        help="of --goal (default 0.05)",
    )
    made.add_argument(
        "--heading-tolerance",
        type=above_zero(180.0),
        default=3.0,
        metavar="DEG",
        help="of --goal (default 3)",
    )
    made.add_argument(
        "--at",
        type=moment,
        default=0.0,
        metavar="S",
        help="time of the world at the start (default 0)",
    )
