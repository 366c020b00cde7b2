"""Drawings of failures, selected to cover many families and kinds of failure."""

import json
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Final, NamedTuple, TypeAlias

import pyarrow as pa

from plant.model.errors import WorldError
from protocol.wire.reasons import Reason
from protocol.world import World
from runtime.errors import UserError
from study.intervals import CONFIDENT
from study.report.drives import DrivenTrial, attempt_all
from study.report.page import Block, Gallery, PageFigure, PageSection, Paragraph
from study.report.trials import NOISES, Trials
from study.report.world_map import WorldMap
from study.runner.plan import OwnFile
from study.runner.rows import FAILED, TrialRow
from study.runner.run_task import trial_of
from study.runner.store import rows_of
from study.trial.trial import Trial

WorldOf: TypeAlias = Callable[[str], World]
"""Returns the world of a row's `world_source`; raises WorldError, UserError or ValueError."""

PER_NAVIGATOR: Final = 6
WIDTH: Final = 330.0
FIXED_PLACE: Final = "plant/corpus/fixed"


class SelectedFailure(NamedTuple):
    """A selected failure."""

    label: str
    kind: str
    row: TrialRow


def selected_failures(table: pa.Table, trials: Trials, most: int) -> list[SelectedFailure]:
    """Select up to `most` failures of each navigator: frequent kinds first, then new ones.

    The column `place` of `trials` holds the row of the table.
    """
    found: list[SelectedFailure] = []
    for label in trials.labels():
        some = trials.of(label=label)
        failures = some.where(~(some.success | some.has(outcome=FAILED)))
        places = failures.numbers("place").astype(int).tolist()
        rows = rows_of(table.take(places)) if places else []
        found += [SelectedFailure(label, kind_of(row), row) for row in diverse(rows, most)]
    return found


def kind_of(row: TrialRow) -> str:
    """Return the kind of a failure."""
    if row.goal_reason == Reason.UNREACHABLE and row.reachable is not False:
        return "called unreachable"
    if row.outcome == "reached":
        return "hit by an obstacle" if row.contacts else "reached"
    return row.outcome


def diverse(rows: list[TrialRow], most: int) -> list[TrialRow]:
    """Select one row of each kind and family in turn, new kinds and families first."""
    groups: dict[tuple[str, str], list[TrialRow]] = {}
    for row in sorted(rows, key=_order):
        groups.setdefault((kind_of(row), row.family), []).append(row)
    picked: list[TrialRow] = []
    kinds: set[str] = set()
    families: set[str] = set()
    while groups and len(picked) < most:
        best = min(
            groups,
            key=lambda key: (key[0] in kinds, key[1] in families, -len(groups[key]), key),
        )
        picked.append(groups.pop(best)[0])
        kinds.add(best[0])
        families.add(best[1])
    return picked


def _order(row: TrialRow) -> tuple[int, float, str, int]:
    """Return the sort key: least noise first, then the shortest drive, which are easiest to see."""
    noise = NOISES.index(row.noise) if row.noise in NOISES else len(NOISES)
    return noise, row.time_s, row.trial_id, row.seed


def gallery(
    found: list[SelectedFailure],
    world_of: WorldOf,
    jobs: int,
    own: Mapping[str, OwnFile] = MappingProxyType({}),
) -> PageSection:
    """Run the selected failures once more and draw them."""
    figures: dict[str, list[PageFigure]] = {}
    lost: list[str] = []
    for number, (one, drive) in enumerate(
        zip(found, rerun(found, world_of, jobs, own), strict=True)
    ):
        if isinstance(drive, DrivenTrial):
            name = f"failure-{number + 1:02d}"
            figures.setdefault(one.label, []).append(_figure(one, drive, name))
        else:
            lost.append(f"`{one.row.trial_id[:12]}` in {one.row.world}: {drive}")
    parts = tuple(PageSection(label, (Gallery(tuple(some)),)) for label, some in figures.items())
    blocks: tuple[Block, ...] = (
        Paragraph(LEGEND if figures else "No trial failed, or none was selected."),
    )
    if lost:
        blocks += (Paragraph("Could not be run again: " + "; ".join(lost) + "."),)
    return PageSection("Failures", blocks, parts)


def rerun(
    found: list[SelectedFailure], world_of: WorldOf, jobs: int, own: Mapping[str, OwnFile]
) -> list[DrivenTrial | str]:
    """Run each failure again; return an error as text."""
    trials: dict[int, Trial] = {}
    results: dict[int, DrivenTrial | str] = {}
    for index, one in enumerate(found):
        try:
            trials[index] = trial_of(one.row, world_of(one.row.world_source), own)
        except (UserError, WorldError, ValueError) as error:
            results[index] = (str(error).splitlines() or [""])[0]
    results.update(zip(trials, attempt_all(list(trials.values()), jobs), strict=True))
    return [results[index] for index in range(len(found))]


OTHER: Final = "the code differs, or the machine rounds differently"
LEGEND: Final = (
    "Some failures of each navigator, selected by rule: every kind of failure and every family in "
    "turn, the least noise and the shortest drive first. Coloured: the true path; dotted: the "
    f"estimated path, ending in its {CONFIDENT} ellipse; small dot: start; ring: goal, with its "
    "heading if one is required. The path ends in a disc if the goal was reached, a square if the "
    "robot was stuck, a bar if it called the goal unreachable, a rhombus if it was lost, a "
    "triangle after a timeout, a cross after a contact. Moving obstacles are "
    "drawn at their start, with their path."
)


def _figure(one: SelectedFailure, drive: DrivenTrial, name: str) -> PageFigure:
    row, outcome = one.row, drive.outcome
    title = f"{one.label} in {row.world}, noise {row.noise}, seed {row.seed}: {one.kind}"
    plan = WorldMap(drive.trial.world, WIDTH, title)
    plan.straight()
    plan.add(drive, belief=True)
    plan.ends()
    note = f"{row.family}; {row.reason}; {row.time_s:.0f} s, {row.path_m:.1f} m"
    if row.shortest_path_m:
        note += f" of {row.shortest_path_m:.1f} m"
    note += f"; trial `{row.trial_id[:12]}`"
    if outcome.digest != row.digest:
        note += f". **This is not the recorded drive**: {OTHER}"
    caption = f"**{row.world}**, {row.noise}, seed {row.seed}: **{one.kind}**"
    return PageFigure(name, plan.drawing, caption, note, command_of(row, drive.trial.navigator))


def command_of(row: TrialRow, navigator: str = "") -> str:
    """Return the command that repeats the drive, to be run in the project's directory.

    `navigator` is the reference of one of the user's own.
    """
    world, before = _world_file(row.world_source)
    parameters: dict[str, float] = json.loads(row.parameters or "{}")
    words = [
        *("sidestep trial --world", world, "--navigator", navigator or row.navigator),
        *("--side", row.side),
        *("--seed", str(row.seed), "--noise", row.noise, "--timeout", f"{row.timeout_s:g}"),
        *(f"--param {name}={value!r}" for name, value in parameters.items()),
        *(() if row.calibrated else ("--uncalibrated",)),
    ]
    return before + " ".join(words)


def _world_file(source: str) -> tuple[str, str]:
    """Return the world for `sidestep trial`, and commands that must precede it."""
    kind, _, rest = source.partition(":")
    if kind == "corpus":
        family, seed, index = rest.split(":")
        make = f"sidestep worlds generate --family {family} --per-family {int(index) + 1}"
        file = f"worlds/{family}_{seed}_{int(index):03d}.toml"
        return file, f"{make} --seed {seed} --out worlds\n"
    places = {
        "shipped": rest,
        "fixed": f"{FIXED_PLACE}/{rest}.toml",
        "kept": f"STUDY/worlds/{rest}",
    }
    return places.get(kind, source), ""
