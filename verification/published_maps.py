"""Drive maps of two published benchmarks, and print one line of results for each.

`python -m verification.published_maps --barn DIR --moving-ai DIR` reads the files `world_N.world`
of the BARN challenge and the `.map` files of Moving AI. Neither is part of this project: both are
in public repositories (see docs/evidence/published-maps.md).
"""

import argparse
import sys
import tempfile
from collections.abc import Iterator, Sequence
from functools import partial
from multiprocessing import Pool
from pathlib import Path
from typing import Final, NamedTuple
from xml.etree import ElementTree

from plant.imports.anyone import CELL_M, ImportOptions, import_worlds
from plant.model.errors import Problem, WorldError
from plant.model.noise import LEVELS
from plant.model.types import World
from protocol.outcome import LOST, UNREACHABLE
from robot.core.parameters import DEFAULTS
from study.runner.plan import seed_of, time_for
from study.runner.scores import published_score
from study.runner.sources import digest_of
from study.trial.trial import Trial, run_trial

SCALES: Final = (1.0, 0.75, 0.55)
"""The last one gives our robot of 0.24 m the room that the benchmark's robot of 0.43 m has."""
START_M: Final = (-2.0, 3.0)
"""Start of the challenge, in the frame of its worlds; the goal lies behind the cylinders."""
GOAL_M: Final = (-2.0, 9.6)
BEYOND_M: Final = 0.5
WINDOW: Final = 24
WINDOWS: Final = 15
"""Windows tried of each map; those without two free places are left out."""
HEADER: Final = (
    "| maps | noise | arrived, touched nothing | touched | `unreachable` | `lost` | score |"
)


class Run(NamedTuple):
    """Result of one trial."""

    arrived: bool
    touched: bool
    outcome: str
    score: float


def cylinders(path: Path, scale: float) -> str:
    """Return the cylinders of a Gazebo world as a list for `sidestep worlds import`.

    Raises WorldError for a file that is no XML.
    """
    try:
        models = ElementTree.parse(path).iter("model")
    except ElementTree.ParseError as error:
        fix = "give the worlds of the BARN challenge"
        problem = Problem(str(path), error.position[0], "xml", f"not a Gazebo world: {error}", fix)
        raise WorldError([problem]) from None
    lines = []
    for model in models:
        radius = model.find("./link/collision/geometry/cylinder/radius")
        pose = model.find("pose")
        if radius is not None and pose is not None:
            x_m, y_m = (scale * float(word) for word in (pose.text or "").split()[:2])
            lines.append(f"{x_m:.5f},{y_m:.5f},{scale * float(radius.text or ''):.5f}\n")
    return "".join(lines)


def barn_worlds(directory: Path, scale: float) -> Iterator[World]:
    """Yield the worlds of the challenge, smaller by a factor."""
    start = (scale * START_M[0], scale * START_M[1])
    goal = (scale * GOAL_M[0], scale * GOAL_M[1] + BEYOND_M)
    with tempfile.TemporaryDirectory() as made:
        for path in sorted(directory.glob("world_*.world")):
            listed = Path(made, f"{path.stem}.csv")
            listed.write_text(cylinders(path, scale), encoding="utf-8")
            yield from import_worlds(listed, ImportOptions(start=start, goal=goal))


def windows(directory: Path) -> Iterator[World]:
    """Yield windows of maps in which a start and a goal were found."""
    for path in sorted(directory.glob("*.map")):
        for seed in range(1, WINDOWS + 1):
            try:
                yield from import_worlds(path, ImportOptions(seed=seed, window=WINDOW))
            except WorldError:
                continue


def drive(level: str, world: World) -> Run:
    """Run one trial with `vgm_memory`."""
    seed = seed_of(digest_of(world), 0)
    outcome = run_trial(Trial(world=world, seed=seed, noise=level, timeout_s=time_for(world)))
    touched = outcome.contacts > 0
    arrived = outcome.reached and not touched
    way_m, fastest_m_s = outcome.shortest_path_m, DEFAULTS.v_max_m_s
    score = published_score(arrived, outcome.time_s, way_m, fastest_m_s) or 0.0
    return Run(arrived, touched, outcome.outcome, score)


def line(name: str, level: str, runs: Sequence[Run]) -> str:
    """Return one row of the table."""
    count = len(runs)
    arrived = sum(run.arrived for run in runs)
    wrong = sum(run.outcome == UNREACHABLE for run in runs)
    lost = sum(run.outcome == LOST for run in runs)
    score = sum(run.score for run in runs) / count
    share = f"{arrived} of {count} ({100.0 * arrived / count:.1f} %)"
    touched = sum(run.touched for run in runs)
    return f"| {name} | {level} | {share} | {touched} | {wrong} | {lost} | {score:.3f} |"


def map_sets(barn: Path | None, moving_ai: Path | None) -> dict[str, list[World]]:
    """Return the worlds of each set by its name in the table; raise WorldError."""
    sets: dict[str, list[World]] = {}
    if barn:
        for scale in SCALES:
            sets[f"BARN x {scale:g}"] = list(barn_worlds(barn, scale))
    if moving_ai:
        sets[f"Moving AI, {CELL_M:g} m cells"] = list(windows(moving_ai))
    return sets


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the table; return 2 without maps."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--barn", type=Path, metavar="DIR", help="directory of world_N.world")
    parser.add_argument("--moving-ai", type=Path, metavar="DIR", help="directory of .map files")
    parser.add_argument("--noise", nargs="+", choices=list(LEVELS), default=["none", "default"])
    found = parser.parse_args(arguments)
    try:
        sets = map_sets(found.barn, found.moving_ai)
    except WorldError as error:
        print(error, file=sys.stderr)
        return 2
    if not any(sets.values()):
        print("no maps: give --barn or --moving-ai with a directory of them", file=sys.stderr)
        return 2
    print(f"{HEADER}\n|---|---|---|---:|---:|---:|---:|")
    with Pool() as pool:
        for name, worlds in sets.items():
            for level in found.noise if worlds else ():
                print(line(name, level, pool.map(partial(drive, level), worlds, 4)), flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
