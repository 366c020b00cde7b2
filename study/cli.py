"""`sidestep trial`: one run in this process, as fast as the machine allows."""

import argparse
import json
import sys
from collections.abc import Sequence

from plant.noise import LEVELS
from plant.world_file import load
from protocol.errors import UserError
from protocol.options import add_param_option, whole
from protocol.outcome import Outcome
from robot.parameters import OutOfRange, Unknown
from study.trace import Trace
from study.trial import NAVIGATORS, SIDES, USUAL_NAVIGATOR, Trial, params_of, run_trial

LONGEST_S = 24 * 3600.0


def main(argv: Sequence[str] | None = None) -> int:
    """0 reached, 1 not, 2 wrong usage (argparse) or configuration (raised)."""
    verb, *rest = sys.argv[1:] if argv is None else argv
    assert verb == "trial"
    return trial(parser().parse_args(rest))


def trial(options: argparse.Namespace) -> int:
    """Raises WorldError or UserError, which say what to mend."""
    job = Trial(
        world=load(options.world),
        navigator=options.navigator,
        side=options.side,
        seed=options.seed,
        noise=options.noise,
        timeout_s=options.timeout,
        parameters=dict(options.param),
        calibrated=not options.uncalibrated,
    )
    outcome = run(job, options.trace)
    print(json.dumps(outcome.as_json()) if options.json else outcome.text())
    return 0 if outcome.reached else 1


def run(job: Trial, trace: str | None) -> Outcome:
    try:
        params_of(job)  # refused before a file is touched
        if trace is None:
            return run_trial(job)
        with open(trace, "w", encoding="utf-8", newline="") as file:
            return run_trial(job, Trace(file))
    except (Unknown, OutOfRange) as error:
        raise UserError(f"--param or the world's [robot]: {error}") from None
    except OSError as error:
        raise UserError(f"--trace {trace}: cannot be written: {error.strerror}") from None


def parser() -> argparse.ArgumentParser:
    made = argparse.ArgumentParser(prog="sidestep trial", description=__doc__)
    made.add_argument("--world", required=True, help="name of a shipped world, or a .toml file")
    made.add_argument(
        "--navigator", choices=NAVIGATORS, default=USUAL_NAVIGATOR, help=f"({USUAL_NAVIGATOR})"
    )
    made.add_argument("--side", choices=SIDES, default="left", help="on which obstacles are passed")
    made.add_argument("--seed", type=whole(0), default=0, help="of everything random (0)")
    made.add_argument("--noise", choices=LEVELS, help="instead of what the world says")
    made.add_argument("--timeout", type=seconds, default=300.0, metavar="S", help="simulated (300)")
    add_param_option(made)
    made.add_argument("--uncalibrated", action="store_true", help="not calibrated for the noise")
    made.add_argument("--trace", metavar="FILE", help="CSV, one line per tick")
    made.add_argument("--json", action="store_true", help="one JSON object on standard output")
    return made


def seconds(text: str) -> float:
    value = float(text)
    if not 0.0 < value <= LONGEST_S:
        raise argparse.ArgumentTypeError(f"{text} is not above 0 and at most {LONGEST_S:g}")
    return value
