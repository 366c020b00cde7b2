"""`sidestep trial`: one run in this process, as fast as the machine allows."""

import argparse
import json
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
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
from robot.parameters.table import OutOfRange, Unknown
from runtime.cli.verb_table import VERBS
from runtime.errors import UserError
from study.trial.trace import Trace
from study.trial.trial import NAVIGATORS, SIDES, USUAL_NAVIGATOR, Trial, params_of, run_trial

MAX_DURATION_S: Final = 24 * 3600.0
FULL_TURN_DEG: Final = 360.0
STANDARD_OUTPUT: Final = "-"
seconds: Final = above_zero(MAX_DURATION_S)
moment: Final = up_to(MAX_DURATION_S)


def main(argv: Sequence[str]) -> int:
    """0 reached, 1 not, 2 wrong usage (argparse) or configuration (raised)."""
    return trial(parser().parse_args(numbers_kept(argv)))


def trial(options: argparse.Namespace) -> int:
    """Raises WorldError or UserError, which say what to mend."""
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
    outcome = run(job, options.trace)
    print(json.dumps(outcome.as_json()) if options.json else outcome.text())
    return 0 if outcome.reached else 1


def run(job: Trial, trace: str | None) -> Outcome:
    try:
        params_of(job)  # refused before a file is touched
        if trace is None:
            return run_trial(job)
        with written(trace) as file:
            return run_trial(job, Trace(file))
    except (Unknown, OutOfRange) as error:
        raise UserError(f"--param or the world's [robot]: {error}") from None
    except OSError as error:
        raise UserError(f"--trace {trace}: cannot be written: {error.strerror}") from None


@contextmanager
def written(trace: str) -> Iterator[TextIO]:
    """The file of that name; `-` is standard output, on which the outcome follows."""
    if trace == STANDARD_OUTPUT:
        yield sys.stdout
        return
    with open(trace, "w", encoding="utf-8", newline="") as file:
        yield file


def start_of(numbers: list[float] | None) -> Start | None:
    """X Y DEG."""
    if numbers is None:
        return None
    x_m, y_m, heading_deg = numbers
    return Start(x_m=x_m, y_m=y_m, heading_rad=turn("--start", heading_deg))


def goal_of(options: argparse.Namespace) -> GoalPose | None:
    """X Y [DEG]; without a heading any will do, as it is with `up --goal`."""
    numbers: list[float] | None = options.goal
    if numbers is None:
        return None
    if len(numbers) not in (2, 3):
        raise UserError(f"--goal is X Y or X Y DEG, not {len(numbers)} numbers")
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
    if abs(heading_deg) > FULL_TURN_DEG:
        limits = f"{-FULL_TURN_DEG:g} to {FULL_TURN_DEG:g} deg"
        raise UserError(f"{option}: heading {heading_deg:g} deg is out of range: {limits}")
    return radians(heading_deg)


def parser() -> argparse.ArgumentParser:
    made = argparse.ArgumentParser(prog="sidestep trial", description=VERBS["trial"].summary)
    made.add_argument("--world", required=True, help="name of a shipped world, or a .toml file")
    made.add_argument(
        "--navigator", choices=NAVIGATORS, default=USUAL_NAVIGATOR, help=f"({USUAL_NAVIGATOR})"
    )
    made.add_argument("--side", choices=SIDES, default="left", help="on which obstacles are passed")
    made.add_argument("--seed", type=whole(0), default=0, help="of everything random (0)")
    made.add_argument("--noise", choices=LEVELS, help="instead of what the world says")
    made.add_argument(
        "--start", type=finite, nargs=3, metavar=("X", "Y", "DEG"), help="instead of the world's"
    )
    made.add_argument(
        "--goal", type=finite, nargs="+", metavar="N", help="X Y [DEG] instead of the world's"
    )
    made.add_argument(
        "--tolerance", type=above_zero(1.0), default=0.05, metavar="M", help="of --goal (0.05)"
    )
    made.add_argument(
        "--heading-tolerance", type=above_zero(180.0), default=3.0, metavar="DEG", help="(3)"
    )
    made.add_argument(
        "--at",
        type=moment,
        default=0.0,
        metavar="S",
        help="time of the world at the start (0)",
    )
    made.add_argument("--timeout", type=seconds, default=300.0, metavar="S", help="simulated (300)")
    add_param_option(made)
    made.add_argument("--uncalibrated", action="store_true", help="not calibrated for the noise")
    made.add_argument("--trace", metavar="FILE", help="CSV, one line per tick; - is stdout")
    made.add_argument("--json", action="store_true", help="one JSON object on standard output")
    return made
