"""The failures, drawn: chosen by rule so that many families and many ways to fail are seen."""

import json
from collections.abc import Callable
from typing import Final, NamedTuple, TypeAlias

import pyarrow as pa

from plant.model.errors import WorldError
from plant.model.types import World
from protocol.wire.reasons import Reason
from runtime.errors import UserError
from study.report.charts.drives import Drive, all_attempted
from study.report.charts.world_map import Map
from study.report.page import Block, Figure, Gallery, Section, Text
from study.report.trials import NOISES, Trials
from study.runner.rows import FAILED, TrialRow, rows_of
from study.runner.run_task import trial_of
from study.statistics.intervals import CONFIDENT
from study.trial.trial import Trial

WorldOf: TypeAlias = Callable[[str], World]
"""Makes a world from a row's `world_source`; raises WorldError, UserError or ValueError."""

PER_NAVIGATOR: Final = 6
WIDTH: Final = 330.0
FIXED_PLACE: Final = "plant/corpus/fixed"


class ChosenDrives(NamedTuple):
    label: str
    kind: str
    row: TrialRow


def chosen(table: pa.Table, trials: Trials, most: int) -> list[ChosenDrives]:
    """Up to `most` failures of each navigator, the commonest kinds first, then what is new.

    `trials` holds in its column `place` the row of the table.
    """
    found: list[ChosenDrives] = []
    for label in trials.labels():
        some = trials.of(label=label)
        failures = some.where(~(some.success | some.has(outcome=FAILED)))
        places = failures.numbers("place").astype(int).tolist()
        rows = rows_of(table.take(places)) if places else []
        found += [ChosenDrives(label, kind_of(row), row) for row in varied(rows, most)]
    return found


def kind_of(row: TrialRow) -> str:
    if row.goal_reason == Reason.UNREACHABLE and row.reachable is not False:
        return "called unreachable"
    if row.outcome == "reached":
        return "was run into" if row.contacts else "reached"
    return row.outcome


def varied(rows: list[TrialRow], most: int) -> list[TrialRow]:
    """One of each kind and family in turn, those first that bring in a new kind or family."""
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
    """The least noise first, then the shortest drive: the clearest to look at."""
    noise = NOISES.index(row.noise) if row.noise in NOISES else len(NOISES)
    return noise, row.time_s, row.trial_id, row.seed


def gallery(found: list[ChosenDrives], world_of: WorldOf, jobs: int) -> Section:
    """Runs the chosen once more and draws them."""
    figures: dict[str, list[Figure]] = {}
    lost: list[str] = []
    for number, (one, drive) in enumerate(zip(found, again(found, world_of, jobs), strict=True)):
        if isinstance(drive, Drive):
            name = f"failure-{number + 1:02d}"
            figures.setdefault(one.label, []).append(_figure(one, drive, name))
        else:
            lost.append(f"`{one.row.trial_id[:12]}` in {one.row.world}: {drive}")
    parts = tuple(Section(label, (Gallery(tuple(some)),)) for label, some in figures.items())
    blocks: tuple[Block, ...] = (Text(LEGEND if figures else "No trial failed, or none was kept."),)
    if lost:
        blocks += (Text("Could not be run again: " + "; ".join(lost) + "."),)
    return Section("Failures", blocks, parts)


def again(found: list[ChosenDrives], world_of: WorldOf, jobs: int) -> list[Drive | str]:
    """Each once more, or in words why not."""
    trials: dict[int, Trial] = {}
    results: dict[int, Drive | str] = {}
    for index, one in enumerate(found):
        try:
            trials[index] = trial_of(one.row, world_of(one.row.world_source))
        except (UserError, WorldError, ValueError) as error:
            results[index] = (str(error).splitlines() or [""])[0]
    results.update(zip(trials, all_attempted(list(trials.values()), jobs), strict=True))
    return [results[index] for index in range(len(found))]


OTHER: Final = "the code is another one, or the machine rounds otherwise"
LEGEND: Final = (
    "Some failures of each navigator, chosen by rule: every kind of failure and every family gets "
    "its turn, the least noise and the shortest drive first. Coloured: the true way; dotted: where "
    f"the robot believed to be, ending in its {CONFIDENT} ellipse; small dot: start; ring: goal, "
    "with its heading where one was asked for. The way ends in a disc where it reached, a square "
    "where it was stuck, a triangle where time was up, a cross where it had touched something. "
    "What moves is drawn where it began, with its path."
)


def _figure(one: ChosenDrives, drive: Drive, name: str) -> Figure:
    row, outcome = one.row, drive.outcome
    says = f"{one.label} in {row.world}, noise {row.noise}, seed {row.seed}: {one.kind}"
    plan = Map(drive.trial.world, WIDTH, says)
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
    return Figure(name, plan.drawing, caption, note, command_of(row))


def command_of(row: TrialRow) -> str:
    """What shows the same drive, from the project's directory."""
    world, before = _world_file(row.world_source)
    parameters: dict[str, float] = json.loads(row.parameters or "{}")
    words = [
        *("sidestep trial --world", world, "--navigator", row.navigator, "--side", row.side),
        *("--seed", str(row.seed), "--noise", row.noise, "--timeout", f"{row.timeout_s:g}"),
        *(f"--param {name}={value!r}" for name, value in parameters.items()),
        *(() if row.calibrated else ("--uncalibrated",)),
    ]
    return before + " ".join(words)


def _world_file(source: str) -> tuple[str, str]:
    """How `sidestep trial` is told the world, and what has to be typed before."""
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
