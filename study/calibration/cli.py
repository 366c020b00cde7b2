"""`sidestep calibrate`: find wheels, track and slip of a robot from squares driven both ways."""

import argparse
import json
import shlex
from collections.abc import Sequence
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path

from numpy.linalg import LinAlgError

from plant.model.configuration import LEVELS
from protocol.options import add_param_option, whole
from robot.core.parameters import DEFAULTS, Params
from robot.parameters.table import OutOfRangeError, adjusted, with_values
from runtime.cli.parsers import new_parser
from runtime.errors import UserError
from study.calibration import log, plot
from study.calibration.fit import fit_parameters
from study.calibration.result import CalibrationResult, as_toml, store
from study.calibration.runs import SquareRun
from study.calibration.squares import drive
from study.calibration.umbmark import umbmark

RUNS = 20
MAX_RUNS = 1000
MIN_SIDE_M, MAX_SIDE_M = 0.5, 50.0
"""Limits of the side of a square."""
SIDE_M = 4.0
PLOTS = (".svg", ".png")
DETAILS = (
    "Drives UMBmark squares in the plant, or reads a log of them, and finds wheel_ratio, track_m,"
    " k_r_m and k_l_m.\nA value is set only when it differs significantly.\n"
)


def main(argv: Sequence[str]) -> int:
    """Return 0, or 2 for wrong usage (argparse); raise ConfigError or UserError for a bad log."""
    options = parser().parse_args(list(argv))
    check_options(options)
    params = adjusted(DEFAULTS, dict(options.param), "--param")
    result = from_log(options, params) if options.log else from_plant(options, params)
    try:
        save(options, result, shlex.join(["sidestep", "calibrate", *argv]))
    except OSError as error:
        raise UserError(f"{error.filename}: cannot be written: {error.strerror}") from error
    print(json.dumps(result.as_json()) if options.json else result.text())
    return 0


def from_plant(options: argparse.Namespace, params: Params) -> CalibrationResult:
    """Drive squares, fit the parameters, and drive again with the fitted ones."""
    noise, side_m = LEVELS[options.noise], options.side
    first = drive(noise, params, options.runs, 2 * options.seed, side_m)
    fit = fit_parameters(first, params)
    after = with_values(params, fit.adopted(params))
    even = replace(noise, slip_variance_m=0.0)
    before_m, after_m = (
        umbmark(drive(even, which, 1, 0, side_m), which, side_m).largest_m
        for which in (params, after)
    )
    return CalibrationResult(
        source=f"{options.runs} squares of {side_m:g} m in each direction in the plant,"
        f" noise {options.noise}, seed {options.seed}",
        side_m=side_m,
        before=params,
        fit=fit,
        first=first,
        second=drive(noise, after, options.runs, 2 * options.seed + 1, side_m),
        unslipped=(before_m, after_m),
    )


def from_log(options: argparse.Namespace, params: Params) -> CalibrationResult:
    """Fit the runs of a real robot; the result evaluates the same runs before and after.

    Raises UserError for runs that no robot can have driven.
    """
    runs: list[SquareRun] = log.read(Path(options.log))
    try:
        fit = fit_parameters(runs, params)
        with_values(params, fit.adopted(params))
    except (OutOfRangeError, LinAlgError) as error:
        raise UserError(
            f"{options.log}: these runs fit no robot ({error}); check the measured poses, whether"
            " left and right are swapped, and m_per_tick (--param)"
        ) from error
    return CalibrationResult(
        source=f"{len(runs)} squares of {options.side:g} m from {options.log}; after: the same",
        side_m=options.side,
        before=params,
        fit=fit,
        first=runs,
        second=runs,
    )


def save(options: argparse.Namespace, result: CalibrationResult, command: str) -> None:
    """Write the files that the options name; raise OSError."""
    if options.save_log:
        log.write(Path(options.save_log), result.first)
    if options.output:
        Path(options.output).write_text(as_toml(result, command), encoding="utf-8")
    if options.state:
        store(Path(options.state), DEFAULTS, result.values)
    if options.plot:
        plot.write(Path(options.plot), result)


def check_options(options: argparse.Namespace) -> None:
    """Raise UserError for options that argparse cannot check, before the drives begin."""
    if options.log and options.save_log:
        raise UserError("--save-log saves driven runs, not those of --log; leave one of them out")
    if options.plot and Path(options.plot).suffix not in PLOTS:
        raise UserError(f"--plot {options.plot}: name a file that ends in {' or '.join(PLOTS)}")
    if options.plot and find_spec("matplotlib") is None:
        raise UserError("--plot needs matplotlib: pip install 'sidestep[study]'")


def parser() -> argparse.ArgumentParser:
    """Return the parser of the verb."""
    made = new_parser("calibrate", details=f"{DETAILS}\n{log.__doc__}".rstrip(), allow_abbrev=True)
    made.add_argument(
        "--noise", choices=LEVELS, default="default", help="of the plant (default default)"
    )
    made.add_argument("--seed", type=whole(0), default=0, help="of the random numbers (default 0)")
    made.add_argument(
        "--runs",
        type=whole(2, MAX_RUNS),
        default=RUNS,
        metavar="N",
        help=f"squares in each direction (default {RUNS})",
    )
    made.add_argument(
        "--side",
        type=length,
        default=SIDE_M,
        metavar="M",
        help=f"of the square (default {SIDE_M:g})",
    )
    add_param_option(made, "the robot's present parameters, as often as needed")
    made.add_argument("--log", metavar="FILE", help="use the runs in this file (see below)")
    made.add_argument("--save-log", metavar="FILE", help="write the runs to such a file")
    made.add_argument("--output", metavar="FILE", help="TOML for `sidestep run robot --config`")
    made.add_argument("--state", metavar="DIR", help="save for `sidestep run robot --state DIR`")
    made.add_argument("--plot", metavar="FILE", help="return errors before and after, .svg or .png")
    made.add_argument("--json", action="store_true", help="print one JSON object")
    return made


def length(text: str) -> float:
    """Parse the side of a square in m; raise ArgumentTypeError outside the limits."""
    try:
        value = float(text)
    except ValueError:
        value = float("nan")
    if not MIN_SIDE_M <= value <= MAX_SIDE_M:
        limits = f"{MIN_SIDE_M:g} to {MAX_SIDE_M:g} m"
        raise argparse.ArgumentTypeError(f"{text!r} is not a length of {limits}")
    return value
