"""Trials and studies in this process: `sidestep.trial`, `sidestep.study`, `sidestep.worlds`.

No robot, no bus and no other process is needed. Equal calls give equal results, to the bit.
"""

import os
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, fields, replace
from html import escape
from math import isfinite, radians
from numbers import Real
from pathlib import Path
from statistics import median
from time import monotonic
from typing import TYPE_CHECKING, Any, Final, TypeAlias

import protocol.world
from plant.model.configuration import LEVELS
from plant.shortest_path import known_length_m
from plant.sim.simulation import Plant
from plant.world.file import load, shipped
from protocol.navigators import DEFINED, USUAL_NAVIGATOR, is_own, named_by, own_source
from protocol.outcome import RunOutcome
from protocol.wire.enums import Branch, GoalState, Mode, Vehicle
from protocol.wire.reasons import reason_text
from protocol.world import GoalPose, Start
from robot.core.navigators.registry import NavigatorStep
from robot.core.values import Outputs
from robot.own_navigator import defined
from robot.parameter_table import OutOfRangeError, UnknownParameterError
from runtime.errors import UserError
from sidestep.table import Table, Value
from study.cli.trial import COLUMNS, elsewhere, tick_values
from study.report.drives import DrivenTrial
from study.report.world_map import WorldMap
from study.runner.plan import (
    ListedWorld,
    OwnFile,
    StudySettings,
    WorldSelection,
    digest_of,
    listed,
    split_side,
    tasks_of,
    unknown,
)
from study.runner.rows import code
from study.runner.run_task import StudyContext, row_of
from study.runner.workers import Pool
from study.trial.core_loop import CoreLoop
from study.trial.trial import ALL_NAVIGATORS, SIDES, Trial, run_trial

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

    from study.runner.rows import TrialRow

WIDTH: Final = 420.0
"""Of a map in pixels."""


@dataclass(frozen=True, slots=True, kw_only=True)
class World(protocol.world.World):
    """A world, which a notebook shows as a map."""

    def to_dict(self) -> dict[str, Value]:
        """Return the fields of one row of `worlds`."""
        width_m, height_m = self.size_m
        return {
            "name": self.name,
            "family": self.family,
            "width_m": width_m,
            "height_m": height_m,
            "obstacles": len(self.obstacles),
            "start_x_m": self.start.x_m,
            "start_y_m": self.start.y_m,
            "goal_x_m": self.goal.x_m,
            "goal_y_m": self.goal.y_m,
            "shortest_path_m": known_length_m(self),
        }

    def _repr_svg_(self) -> str:
        """Draw the world with its start and its goal."""
        return map_of(self).drawing.alone()


WorldLike: TypeAlias = str | os.PathLike[str] | protocol.world.World
"""The name of a shipped world, the path of a world file, or a world."""

NavigatorLike: TypeAlias = str | os.PathLike[str] | NavigatorStep
"""The name of a navigator, a file such as my_nav.py, or a function."""


class Worlds(Mapping[str, World]):
    """The shipped worlds by name: `sidestep.worlds["u_trap"]`."""

    def __getitem__(self, name: str) -> World:
        if name not in shipped():
            raise UserError(unknown("world", str(name), shipped()))
        return shown(load(name))

    def __contains__(self, name: object) -> bool:
        return name in shipped()

    def __iter__(self) -> Iterator[str]:
        return iter(shipped())

    def __len__(self) -> int:
        return len(shipped())

    def load(self, path: str | os.PathLike[str]) -> World:
        """Read a world file; raise ValueError with line, key and remedy for a bad one."""
        file = Path(text_of("path", path, "the path of a world file"))
        if not file.is_file():
            raise UserError(f"{file}: there is no such world file")
        return shown(load(file))

    def table(self) -> Table:
        """Return a row for each shipped world."""
        return Table.of_rows(world.to_dict() for world in self.values())

    def to_dict(self) -> dict[str, list[Value]]:
        """Return the columns of `table`."""
        return self.table().to_dict()

    def to_pandas(self) -> "pd.DataFrame":
        """Return `table` as a DataFrame."""
        return self.table().to_pandas()

    def __repr__(self) -> str:
        return f"<sidestep.worlds: {', '.join(self)}>"

    def _repr_html_(self) -> str:
        """Show the table in a notebook."""
        return self.table()._repr_html_()


worlds: Final = Worlds()


def shown(world: protocol.world.World) -> World:
    """Return the same world as one that a notebook shows."""
    if isinstance(world, World):
        return world
    return World(**{one.name: getattr(world, one.name) for one in fields(world)})


def world_of(given: WorldLike) -> World:
    """Return a world by its name or path."""
    if isinstance(given, protocol.world.World):
        return shown(given)
    text = text_of("world", given, WORLD_KINDS)
    if isinstance(given, str) and text in worlds:
        return worlds[text]
    if not text or not (text.endswith(".toml") or Path(text).exists()):
        raise UserError(
            f"{unknown('world', text, worlds)}; a world file is given by its path, ending in .toml"
        )
    return worlds.load(given)


WORLD_KINDS: Final = "the name of a world, the path of a world file, or a world"
NAVIGATOR_KINDS: Final = "the name of a navigator, a file such as 'my_nav.py', or a function"


def text_of(what: str, given: object, kinds: str) -> str:
    """Return a name or a path as text; UserError for anything else."""
    text = os.fspath(given) if isinstance(given, os.PathLike) else given
    if not isinstance(text, str):
        raise UserError(f"{what} = {given!r}: give {kinds}")
    return text


def map_of(world: protocol.world.World) -> WorldMap:
    """Return the map of a world with its start and its goal."""
    drawn = WorldMap(world, WIDTH, f"world {world.name}")
    drawn.ends()
    return drawn


def reference_of(given: NavigatorLike) -> str:
    """Return the name of a navigator, or a reference to one of the user's own."""
    if callable(given):
        return defined(given)
    text = text_of("navigator", given, NAVIGATOR_KINDS)
    if text in ALL_NAVIGATORS:
        return text
    name, _, side = text.partition(":")
    if name in ALL_NAVIGATORS:
        chosen("side", side, SIDES)
        raise UserError(f"navigator = {text!r}: give {name!r} and side={side!r}")
    if is_own(text):
        return str(own_source(text))
    raise UserError(f"{unknown('navigator', text, ALL_NAVIGATORS)}; or a file such as 'my_nav.py'")


def chosen(what: str, given: str, known: Iterable[str]) -> str:
    """Return a word that must be one of these; UserError if it is not."""
    if not isinstance(given, str) or given not in known:
        raise UserError(unknown(what, str(given), known))
    return given


STATES: Final[Mapping[str, Callable[[int], str]]] = {
    "vehicle": lambda number: Vehicle(number).name.lower(),
    "mode": lambda number: Mode(number).name.lower(),
    "goal": lambda number: GoalState(number).name.lower(),
    "branch": lambda number: Branch(number).name.lower(),
    "guard": lambda number: reason_text(number) if number else "",
}
"""The words of columns that hold states."""

MILLI: Final = "_mrad_s"


class Recorder:
    """Collects the values of each tick of a trial."""

    def __init__(self) -> None:
        self.ticks: list[tuple[Any, ...]] = []

    def __call__(self, plant: Plant, onboard: CoreLoop, outputs: Outputs) -> None:
        """Keep the values of a tick."""
        self.ticks.append(tick_values(plant, onboard, outputs))

    def table(self) -> Table:
        """Return a column for each value, with words for states, and None where there is none."""
        columns: dict[str, list[Value]] = {}
        for name, values in zip(COLUMNS, zip(*self.ticks, strict=True), strict=True):
            if name in STATES:
                columns[name] = [STATES[name](number) for number in values]
            elif name.endswith(MILLI):
                columns[name.replace(MILLI, "_rad_s")] = [value / 1000.0 for value in values]
            elif name == "contact":
                columns[name] = list(map(bool, values))
            else:  # NaN is the only value that is not equal to itself
                columns[name] = [value if value == value else None for value in values]
        return Table(columns)


@dataclass(frozen=True, slots=True, kw_only=True)
class TrialResult(RunOutcome):
    """How a trial ended, with `trace`: a row for each tick, 20 a second."""

    trial: Trial
    trace: Table

    @property
    def place(self) -> World:
        """The world that was driven in."""
        return shown(self.trial.world)

    def to_dict(self) -> dict[str, Value]:
        """Return the outcome as one row; a list of them makes a table."""
        return {one.name: getattr(self, one.name) for one in fields(RunOutcome)}

    def to_pandas(self) -> "pd.DataFrame":
        """Return the outcome as a DataFrame of one row; `trace.to_pandas()` has the ticks."""
        return Table.of_rows([self.to_dict()]).to_pandas()

    def plot(self) -> "Figure":
        """Draw the map, and ranges, speeds and position error over time, with matplotlib."""
        from sidestep.plots import plot_trial  # slow import: drawing

        return plot_trial(self.trial.world, self.trace, self._headline())

    def _repr_svg_(self) -> str:
        """Draw the true path, and the estimated one dotted."""
        trace = self.trace
        paths: list[list[Any]] = [
            list(zip(*(trace[f"{which}{name}"] for name in POSE), strict=True))
            for which in ("true_", "")
        ]
        covariance: Any = [trace[f"cov_{name}_m2"][-1] for name in ("xx", "xy", "yy")]
        drawn = map_of(self.trial.world)
        labelled = replace(self.trial, navigator=self.navigator)
        true, believed = map(tuple, paths)
        drive = DrivenTrial(
            trial=labelled,
            outcome=self,
            true=true,
            believed=believed,
            branches=(),
            covariance=tuple(covariance),
        )
        drawn.add(drive, belief=None not in covariance)
        return drawn.drawing.alone()

    def _repr_html_(self) -> str:
        """Show the outcome with the map in a notebook."""
        return f"<p>{escape(self._headline())}</p>{self._repr_svg_()}"


POSE: Final = ("x_m", "y_m", "heading_rad")


def trial(
    world: WorldLike = "box",
    navigator: NavigatorLike = USUAL_NAVIGATOR,
    *,
    side: str = "left",
    seed: int = 0,
    noise: str | None = None,
    start: tuple[float, float, float] | None = None,
    goal: tuple[float, float] | tuple[float, float, float] | None = None,
    timeout_s: float = 300.0,
    parameters: Mapping[str, float] | None = None,
    calibrated: bool = True,
) -> TrialResult:
    """Drive to the goal of a world in simulated time, as fast as the computer can.

    `world` is a name of `sidestep.worlds`, the path of a world file, or a world. `navigator` is a
    name, a file of your own such as "my_nav.py", or a function. `noise` is none, default, lossy or
    harsh; None is the level of the world. `start` (x, y, heading) and `goal` (x, y and perhaps
    heading) are metres and degrees, in place of the world's. `parameters` override those of the
    robot by name.

    Raises ValueError (UserError) for what cannot be used. A goal that is not reached is a result.
    """
    place: protocol.world.World = world_of(world)
    if start is not None or goal is not None:
        place = elsewhere(place, start_of(start), goal_of(goal), 0.0)
    asked = Trial(
        world=place,
        navigator=reference_of(navigator),
        side=chosen("side", side, SIDES),
        seed=whole("seed", seed, 0),
        noise=None if noise is None else chosen("noise level", noise, LEVELS),
        timeout_s=above_zero("timeout_s", timeout_s),
        parameters=values_of(parameters),
        calibrated=calibrated,
        moved=start is not None or goal is not None,
    )
    seen = Recorder()
    try:
        outcome = run_trial(asked, seen)
    except (UnknownParameterError, OutOfRangeError) as error:
        raise UserError(f"parameters: {error}") from None
    found = {one.name: getattr(outcome, one.name) for one in fields(RunOutcome)}
    return TrialResult(**found, trial=asked, trace=seen.table())


def start_of(given: tuple[float, float, float] | None) -> Start | None:
    """Return a start of x, y in metres and heading in degrees."""
    if given is None:
        return None
    x_m, y_m, heading_deg = numbers_of("start", given, (3,), "(x_m, y_m, heading_deg)")
    return Start(x_m=x_m, y_m=y_m, heading_rad=heading_rad_of("start", heading_deg))


def goal_of(given: Sequence[float] | None) -> GoalPose | None:
    """Return a goal of x, y in metres and perhaps a heading in degrees."""
    if given is None:
        return None
    form = "(x_m, y_m) or (x_m, y_m, heading_deg)"
    x_m, y_m, *heading_deg = numbers_of("goal", given, (2, 3), form)
    heading_rad = heading_rad_of("goal", heading_deg[0]) if heading_deg else None
    return GoalPose(x_m=x_m, y_m=y_m, heading_rad=heading_rad)


def numbers_of(what: str, given: object, counts: Sequence[int], form: str) -> list[float]:
    """Return so many numbers; UserError for anything else."""
    found = list(given) if isinstance(given, Iterable) else []
    if len(found) not in counts or not all(isinstance(one, Real) for one in found):
        raise UserError(f"{what} = {given!r}: give {form}")
    return found


def heading_rad_of(what: str, heading_deg: float) -> float:
    """Return a heading in radians; UserError beyond a full turn, as for the goals of a robot."""
    if abs(heading_deg) > 360.0:
        raise UserError(f"{what}: heading {heading_deg:g} deg is out of range: -360 to 360 deg")
    return radians(heading_deg)


def values_of(parameters: object) -> dict[str, float]:
    """Return parameters by name; UserError for what is no number."""
    if parameters is None:
        return {}
    if not isinstance(parameters, Mapping):
        raise UserError(f"parameters = {parameters!r}: give a dict, as in {{'v_max_m_s': 0.2}}")
    for name, value in parameters.items():
        if not isinstance(value, Real):
            raise UserError(f"parameters: {name} = {value!r}: must be a number")
    return dict(parameters)


def whole(what: str, given: int, least: int) -> int:
    """Return a whole number from `least` on; UserError for anything else."""
    if isinstance(given, bool) or not isinstance(given, int) or given < least:
        raise UserError(f"{what} = {given!r}: must be a whole number from {least} on")
    return given


def above_zero(what: str, given: float) -> float:
    """Return a finite number above zero; UserError for anything else."""
    if not isinstance(given, int | float) or not isfinite(given) or given <= 0.0:
        raise UserError(f"{what} = {given!r}: must be a finite number above 0")
    return float(given)


class StudyResult:
    """The trials of a study: `trials` has a row for each of them."""

    def __init__(self, rows: "Iterable[TrialRow]", directory: Path | None = None) -> None:
        self.trials = Table.of_rows(
            {one.name: getattr(row, one.name) for one in fields(row)} for row in rows
        )
        self.directory = directory
        """Where the study is kept; None for one in memory."""

    def __len__(self) -> int:
        return len(self.trials)

    def to_dict(self) -> dict[str, list[Value]]:
        """Return the columns of `trials` as lists."""
        return self.trials.to_dict()

    def to_pandas(self) -> "pd.DataFrame":
        """Return `trials` as a DataFrame."""
        return self.trials.to_pandas()

    def summary(self) -> Table:
        """Return a row for each navigator at each noise level.

        `worlds` tells how much the row can say: trials in one world are much alike.
        """
        groups: dict[tuple[Value, ...], list[dict[str, Value]]] = {}
        for row in self.trials:
            groups.setdefault((row["navigator"], row["side"], row["noise"]), []).append(row)
        levels = {name: place for place, name in enumerate(LEVELS)}
        order = sorted(groups, key=lambda key: (*map(str, key[:2]), levels.get(str(key[2]), 0)))
        return Table.of_rows(summary_of(groups[key]) for key in order)

    def report(self) -> Path:
        """Write the report of a study that is kept in a folder; return its page."""
        if self.directory is None:
            raise UserError("report() needs files: call sidestep.study(..., output=FOLDER)")
        from study.cli import report  # slow import: drawing

        return report.report(self.directory, self.directory)[0]

    def plot(self) -> "Figure":
        """Draw for each navigator the share of goals reached without a contact."""
        from sidestep.plots import plot_study  # slow import: drawing

        return plot_study(self.summary())

    def __repr__(self) -> str:
        return f"<StudyResult: {len(self)} trials>"

    def _repr_html_(self) -> str:
        """Show the summary in a notebook."""
        return self.summary()._repr_html_()


def summary_of(rows: list[dict[str, Value]]) -> dict[str, Value]:
    """Return a row of the summary, of trials of one navigator at one noise level."""

    def middle(name: str) -> float | None:
        values = [row[name] for row in rows if row["outcome"] == "reached"]
        found = [value for value in values if isinstance(value, float) and isfinite(value)]
        return median(found) if found else None

    untouched = sum(row["outcome"] == "reached" and not row["contacts"] for row in rows)
    return {
        **{name: rows[0][name] for name in ("navigator", "side", "noise")},
        "worlds": len({row["world_digest"] for row in rows}),
        "trials": len(rows),
        "reached": untouched,
        "reached_share": untouched / len(rows),
        "touched": sum(bool(row["contacts"]) for row in rows),
        "median_time_s": middle("time_s"),
        "median_path_m": middle("path_m"),
        "median_position_error_m": middle("position_error_m"),
    }


def study(
    worlds: WorldLike | Sequence[WorldLike],
    navigators: NavigatorLike | Sequence[NavigatorLike] = USUAL_NAVIGATOR,
    *,
    noise: str | Sequence[str] = "default",
    seeds: int = 1,
    timeout_s: float | None = None,
    parameters: Mapping[str, float] | None = None,
    calibrated: bool = True,
    jobs: int | None = None,
    output: str | os.PathLike[str] | None = None,
) -> StudyResult:
    """Drive each navigator in each world, at each noise level, with so many seeds.

    `worlds` and `navigators` as in `trial`; a navigator may have its side, as in "bug:right", and
    `worlds` may be a folder, "corpus", "fixed" or "shipped". `timeout_s` None depends on the world.
    `jobs` processes work on it, by default all processors. `output` is a folder that keeps the
    trials: the same call continues an interrupted study.

    Raises ValueError (UserError) for what cannot be used.
    """
    steps, levels = several("navigators", navigators), several("noise", noise)
    settings = StudySettings(
        navigators=tuple(dict.fromkeys(map(with_side, steps))),
        noise=tuple(dict.fromkeys(chosen("noise level", one, LEVELS) for one in levels)),
        seeds=whole("seeds", seeds, 1),
        timeout_s=None if timeout_s is None else above_zero("timeout_s", timeout_s),
        parameters=values_of(parameters),
        calibrated=calibrated,
    )
    jobs = whole("jobs", jobs, 1) if jobs is not None else os.cpu_count() or 1
    places = list(places_of(several("worlds", worlds)))
    own = settings.own()
    if any(named_by(file.reference).place == DEFINED for file in own.values()):
        if output is not None:
            raise UserError("a study that is kept needs the file of a navigator, not a function")
        jobs = 1  # other processes do not have the function
    if output is not None:
        return kept_study(places, settings, jobs, Path(output))
    context = StudyContext(study="", code=code(), worlds=[one.world for one in places], own=own)
    tasks = tasks_of(places, settings, context.code.version)
    check_parameters(places, settings, own)
    if jobs == 1 or len(tasks) == 1:
        return StudyResult(row_of(task, context) for task in tasks)
    with Pool(min(jobs, len(tasks)), context) as pool:
        return StudyResult(row for row in pool.run(tasks) if row is not None)


EXAMPLE: Final = "sidestep.study('box', 'vgm_memory', noise='none')"


def several(what: str, given: Any) -> list[Any]:
    """Return one or several values as a list; UserError for none."""
    is_many = isinstance(given, Iterable) and not isinstance(given, str | os.PathLike)
    found = list(given) if is_many else [given]
    if not found:
        raise UserError(f"{what} is empty: name one, as in {EXAMPLE}")
    return found


def with_side(given: NavigatorLike) -> str:
    """Return NAME:SIDE of a navigator, which passes obstacles on the left by default."""
    if callable(given):
        return f"{reference_of(given)}:left"
    name, side = split_side(text_of("navigator", given, NAVIGATOR_KINDS))
    return f"{reference_of(name)}:{side or 'left'}"


def places_of(given: Sequence[WorldLike]) -> Iterator[ListedWorld]:
    """Yield each world of a study, once."""
    found: dict[str, ListedWorld] = {}
    for one in given:
        if isinstance(one, protocol.world.World):
            length_m = known_length_m(one)
            family = one.family or "given"
            known = replace(
                one, family=family, shortest_path_m=length_m, reachable=length_m is not None
            )
            listing = [ListedWorld(f"given:{one.name}", digest_of(one), known)]
        else:
            try:
                place = text_of("world", one, WORLD_KINDS)
                listing = listed(WorldSelection((place,), None, 1, 1))
            except UserError as error:
                raise UserError(str(error).removeprefix("--worlds").lstrip(": ")) from None
        found.update((place.digest, place) for place in listing)
    yield from found.values()


def check_parameters(
    places: Sequence[ListedWorld], settings: StudySettings, own: Mapping[str, OwnFile]
) -> None:
    """Raise UserError for a navigator or a parameter with which no trial can run."""
    from study.trial.trial import params_of

    for reference, side in map(split_side, settings.navigators):
        for place in places:
            asked = Trial(
                world=place.world,
                navigator=reference,
                side=side,
                parameters=settings.parameters,
                calibrated=settings.calibrated,
            )
            try:
                params_of(asked)
            except (UnknownParameterError, OutOfRangeError) as error:
                raise UserError(f"parameters, or [robot] of {place.world.name}: {error}") from None


@contextmanager
def in_words_of_python(mixed: str) -> Iterator[None]:
    """Name `output` as Python does in an error about it; there is no way to mix studies."""
    try:
        yield
    except UserError as error:
        raise UserError(str(error).replace(mixed, "").replace("--output", "output")) from None


def kept_study(
    places: list[ListedWorld], settings: StudySettings, jobs: int, directory: Path
) -> StudyResult:
    """Run a study whose trials are kept in a folder."""
    from study.cli import study_run  # slow import: pyarrow
    from study.runner.conduct import StudyProgress, missing_tasks, stored_rows
    from study.runner.store import MIXED, exclusive, read, rows_of

    if any(place.source.startswith("given:") for place in places):
        raise UserError("output keeps worlds by name or file: give the paths of their files")
    context = StudyContext(
        study=directory.resolve().name,
        code=code(),
        worlds=[place.world for place in places],
        own=settings.own(),
    )
    tasks = tasks_of(places, settings, context.code.version)
    check_parameters(places, settings, context.own)
    prepared = study_run.PreparedStudy(
        directory, places, settings, tasks, context, f"sidestep.study(output={str(directory)!r})"
    )
    with in_words_of_python(MIXED), exclusive(directory):
        for line in study_run.prepare_directory(prepared, mixed=False):
            print(f"sidestep.study: {line}", file=sys.stderr)
        missing = missing_tasks(tasks, stored_rows(directory))
        progress = StudyProgress(len(tasks), len(tasks) - len(missing), sys.stderr, monotonic)
        study_run.run_tasks(prepared, missing, progress, jobs=jobs)
        study_run.write_results(prepared, progress)
        return StudyResult(rows_of(read(directory)), directory)
