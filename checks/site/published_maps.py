"""Drive maps of two published benchmarks, and print a row of results for each.

`python -m checks.site.published_maps --barn DIR --moving-ai DIR` reads the files `world_N.world`
of the BARN challenge and the `.map` files of Moving AI. Neither is part of this project: both are
in public repositories (see docs/evidence/published-maps.md). `sidestep study report --evidence`
reads the file that `--output` writes.
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

import msgspec

from plant.imports.importer import CELL_M, ImportOptions, import_worlds
from plant.model.configuration import LEVELS
from plant.model.errors import WorldError, WorldProblem
from protocol.outcome import LOST, UNREACHABLE
from protocol.world import World
from robot.core.parameters import DEFAULTS
from runtime.errors import UserError
from study.intervals import mean, mean_interval
from study.report.evidence import (
    CYLINDERS,
    GRID_MAPS,
    MapResult,
    PublishedMaps,
    read_maps,
)
from study.report.page import DASH, PageTable, interval, number, percent, table_lines, with_text
from study.report.targets import MAP_RATES, SCORE, least, verdict_of
from study.runner.plan import digest_of, seed_of, time_for
from study.runner.run_task import FULL_SCORE, published_score
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
HEAD: Final = (
    *("maps", "noise", "arrived, touched nothing", "% [interval]", "touched"),
    *("`unreachable`", "bound, %", "`lost`", "other", "score", "interval", "wanted", ""),
)
BEGIN: Final = "<!-- published-maps:begin -->"
END: Final = "<!-- published-maps:end -->"


class MapSet(NamedTuple):
    """Worlds of one benchmark at one scale."""

    name: str
    scale: float
    worlds: Sequence[World]


class MapRun(NamedTuple):
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
        problem = WorldProblem(
            str(path), error.position[0], "xml", f"not a Gazebo world: {error}", fix
        )
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


def drive(level: str, world: World) -> MapRun:
    """Run one trial with `vgm_memory`."""
    seed = seed_of(digest_of(world), 0)
    outcome = run_trial(Trial(world=world, seed=seed, noise=level, timeout_s=time_for(world)))
    touched = outcome.contacts > 0
    arrived = outcome.reached and not touched
    way_m, fastest_m_s = outcome.shortest_path_m, DEFAULTS.v_max_m_s
    score = published_score(arrived, outcome.time_s, way_m, fastest_m_s) or 0.0
    return MapRun(arrived, touched, outcome.outcome, score)


def result(maps: MapSet, level: str, runs: Sequence[MapRun]) -> MapResult:
    """Return the counts and the mean score of the trials in a set of maps."""
    scores = [run.score for run in runs]
    span = mean_interval(scores)
    ended = (UNREACHABLE, LOST)
    return MapResult(
        maps=maps.name,
        scale=maps.scale,
        noise=level,
        trials=len(runs),
        arrived=sum(run.arrived for run in runs),
        touched=sum(run.touched for run in runs),
        unreachable=sum(run.outcome == UNREACHABLE for run in runs),
        lost=sum(run.outcome == LOST for run in runs),
        other=sum(not run.arrived and not run.touched and run.outcome not in ended for run in runs),
        score=mean(scores),
        score_low=max(0.0, span.low),
        score_high=min(FULL_SCORE, span.high),
    )


def table(results: Sequence[MapResult]) -> str:
    """Return the table of the page."""
    return table_lines(PageTable("", HEAD, tuple(map(cells, results)), names=2))


def cells(one: MapResult) -> tuple[str, ...]:
    """Return one row of the table."""
    is_grid = one.maps == GRID_MAPS
    wanted, verdict = DASH, DASH
    if not is_grid:
        wanted, verdict = f"score ≥ {SCORE:g}", verdict_of(one.score >= SCORE)
    elif one.noise in MAP_RATES:
        rate = MAP_RATES[one.noise]
        wanted, verdict = f"arrives {least(rate)}", verdict_of(one.arrivals.rate >= rate)
    low, high = one.arrivals.interval
    return (
        f"{one.maps}, {CELL_M:g} m cells" if is_grid else f"{one.maps} x {one.scale:g}",
        one.noise,
        f"{one.arrived} of {one.trials}",
        f"{percent(one.arrivals.rate)} [{percent(low)}, {percent(high)}]",
        *map(str, (one.touched, one.unreachable)),
        f"≤ {percent(one.wronged.most, 2)}",
        *map(str, (one.lost, one.other)),
        *(number(one.score, 3), interval(one.score_interval, 3)),
        wanted,
        verdict,
    )


def with_table(page: str, text: str) -> str:
    """Return the page with this table between its marks; raise ValueError without marks."""
    return with_text(page, BEGIN, END, f"\n\n{text}\n\n")


def map_sets(barn: Path | None, moving_ai: Path | None) -> list[MapSet]:
    """Return the sets of maps that have a directory; raise WorldError."""
    sets = []
    if barn:
        sets += [MapSet(CYLINDERS, scale, list(barn_worlds(barn, scale))) for scale in SCALES]
    if moving_ai:
        sets.append(MapSet(GRID_MAPS, 1.0, list(windows(moving_ai))))
    return [one for one in sets if one.worlds]


def run_all(sets: Sequence[MapSet], levels: Sequence[str]) -> Iterator[MapResult]:
    """Drive all maps on all cores, and yield the result of each set at each noise level."""
    with Pool() as pool:
        for maps in sets:
            for level in levels:
                yield result(maps, level, pool.map(partial(drive, level), maps.worlds, 4))


def driven(options: argparse.Namespace) -> list[MapResult]:
    """Drive the maps of the options, none without a directory; raise WorldError."""
    results = []
    for one in run_all(map_sets(options.barn, options.moving_ai), options.noise):
        print(one, file=sys.stderr, flush=True)
        results.append(one)
    return results


def write(results: Sequence[MapResult], output: Path | None, page: Path | None) -> None:
    """Write the results as JSON, and the table into the page."""
    if output:
        text = msgspec.json.format(msgspec.json.encode(PublishedMaps(list(results))), indent=1)
        output.write_bytes(text + b"\n")
    if page:
        text_of_page = with_table(page.read_text(encoding="utf-8"), table(results))
        page.write_text(text_of_page, encoding="utf-8")


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the table and write the files; return 2 without maps."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--barn", type=Path, metavar="DIR", help="directory of world_N.world")
    parser.add_argument("--moving-ai", type=Path, metavar="DIR", help="directory of .map files")
    parser.add_argument("--noise", nargs="+", choices=list(LEVELS), default=["none", "default"])
    parser.add_argument(
        "--results", type=Path, metavar="FILE", help="read this JSON, drive nothing"
    )
    parser.add_argument("--output", type=Path, metavar="FILE", help="write the results as JSON")
    parser.add_argument("--page", type=Path, metavar="FILE", help="replace the table in this page")
    options = parser.parse_args(arguments)
    try:
        results = read_maps(options.results) if options.results else driven(options)
    except (UserError, WorldError) as error:
        print(error, file=sys.stderr)
        return 2
    if not results:
        print("no maps: give --barn or --moving-ai with a directory of them", file=sys.stderr)
        return 2
    print(table(results))
    write(results, options.output, options.page)
    return 0


if __name__ == "__main__":
    sys.exit(main())
