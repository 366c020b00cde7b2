"""The command line of `sidestep study`."""

import argparse
from os import cpu_count
from pathlib import Path
from typing import Final

from plant.cli import PER_FAMILY
from plant.model.configuration import LEVELS
from protocol.options import add_param_option, whole
from runtime.cli.parsers import new_parser
from study.cli.trial import seconds
from study.runner.plan import (
    DETOUR_FACTOR,
    EVERY_NAVIGATOR,
    MIN_TIMEOUT_S,
    UNREACHABLE_TIMEOUT_S,
    StudySettings,
    navigator_of,
    noise_of,
)
from study.runner.sources import CORPUS, FIXED, WorldSelection

OUTPUT: Final = "study-results"
QUICK_OUTPUT: Final = "study-quick"
QUICK_NOISE: Final = ("none", "default")
QUICK_PAPER_SEEDS: Final = 5
CORPUS_SEED: Final = 1

DETAILS: Final = (
    "Runs navigators x worlds x noise levels x seeds and writes results.parquet and a report.\n"
    "Give the same command again to continue an interrupted study. `sidestep study report DIR`\n"
    "writes the report again."
)


def parser() -> argparse.ArgumentParser:
    """Return the parser of `sidestep study`."""
    made = new_parser("study", details=DETAILS)
    made.add_argument(
        "--quick",
        action="store_true",
        help="the committed worlds, all navigators, noise none and default: a few minutes",
    )
    _add_worlds(made)
    _add_what(made)
    _add_how(made)
    return made


def _add_worlds(made: argparse.ArgumentParser) -> None:
    made.add_argument(
        "--worlds",
        nargs="+",
        metavar="WHERE",
        help=f"{CORPUS} (generated), {FIXED} (committed), shipped, names of shipped worlds, .toml"
        f" files, or directories of .toml files; {CORPUS} by default",
    )
    made.add_argument("--families", nargs="+", metavar="F", help="only worlds of these families")
    made.add_argument(
        "--per-family",
        type=whole(1),
        default=PER_FAMILY,
        metavar="N",
        help=f"worlds generated of each family (default {PER_FAMILY})",
    )
    made.add_argument(
        "--corpus-seed",
        type=whole(0),
        default=CORPUS_SEED,
        help=f"for generated worlds (default {CORPUS_SEED})",
    )


def _add_what(made: argparse.ArgumentParser) -> None:
    made.add_argument(
        "--navigators",
        nargs="+",
        metavar="NAME[:SIDE]",
        help=f"navigators to run ({' '.join(EVERY_NAVIGATOR)})",
    )
    made.add_argument(
        "--seeds",
        type=whole(1),
        metavar="N",
        help="runs of each trial with different noise (1); one run without noise",
    )
    made.add_argument(
        "--noise", nargs="+", metavar="LEVEL", help=f"noise levels to run (all: {' '.join(LEVELS)})"
    )
    made.add_argument(
        "--timeout",
        type=seconds,
        metavar="S",
        help=f"simulated time; by default for {DETOUR_FACTOR:g} times the shortest path,"
        f" at least {MIN_TIMEOUT_S:g} s, and {UNREACHABLE_TIMEOUT_S:g} s where there is no path",
    )
    add_param_option(made)
    made.add_argument(
        "--uncalibrated", action="store_true", help="do not calibrate robots for their noise"
    )


def _add_how(made: argparse.ArgumentParser) -> None:
    made.add_argument(
        "--jobs", type=whole(1), default=cpu_count() or 1, help="processes (default all cores)"
    )
    made.add_argument("--dask", metavar="ADDRESS", help="run on the Dask cluster of this scheduler")
    made.add_argument(
        "--output",
        type=Path,
        metavar="DIR",
        help=f"{OUTPUT}, or {QUICK_OUTPUT} with --quick",
    )
    made.add_argument(
        "--mixed", action="store_true", help="continue even if settings or code have changed"
    )
    made.add_argument("--no-report", action="store_true", help="write results only")
    made.add_argument("--json", action="store_true", help="print one JSON object")


def selection_of(options: argparse.Namespace) -> WorldSelection:
    """Return the worlds that the options select."""
    places = options.worlds or ([FIXED] if options.quick else [CORPUS])
    return WorldSelection(places, options.families, options.per_family, options.corpus_seed)


def settings_of(options: argparse.Namespace) -> StudySettings:
    """Return the settings; raise UserError for an unknown navigator or noise level."""
    navigators = [navigator_of(text) for text in options.navigators or EVERY_NAVIGATOR]
    noise = [noise_of(text) for text in options.noise or _default_noise(options.quick)]
    return StudySettings(
        navigators=tuple(dict.fromkeys(navigators)),
        noise=tuple(dict.fromkeys(noise)),
        seeds=options.seeds or 1,
        timeout_s=options.timeout,
        parameters=dict(options.param),
        calibrated=not options.uncalibrated,
    )


def _default_noise(quick: bool) -> tuple[str, ...]:
    return QUICK_NOISE if quick else tuple(LEVELS)


def output_of(options: argparse.Namespace) -> Path:
    """Return the study's directory."""
    given: Path | None = options.output
    return given or Path(QUICK_OUTPUT if options.quick else OUTPUT)
