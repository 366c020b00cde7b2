"""The section on the paper: figures 11, 12 and 13 redone, and the verdict on its claims.

Each rule by which trials confirm or refute a claim was fixed before the trials were run. A claim is
unclear where bug's two sides disagree.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple, TypeAlias

from plant.model.configuration import LEVELS
from plant.world.file import load
from study.intervals import CONFIDENT, Proportion, quantile, quantile_interval
from study.report.comparisons import LEVEL, comparison, runs_by_pair
from study.report.drives import (
    PLACES,
    DrivenTrial,
    PaperRuns,
    arrived_untouched,
    deviation_m,
    label_of,
    path_ratios,
    remaining_deviation,
    remaining_turn_deg,
)
from study.report.page import (
    Block,
    Gallery,
    PageCell,
    PageFigure,
    PageSection,
    PageTable,
    Paragraph,
    count_text,
    interval,
    number,
    probability,
    share,
)
from study.report.trials import Flags, Trials
from study.report.world_map import WorldMap

CONFIRMED: Final = "confirmed"
REFUTED: Final = "refuted"
UNCLEAR: Final = "unclear"

BUGS: Final = ("bug, left", "bug, right")
LONGER: Final = 1.05
RETURNED: Final = 0.25
ORIENTED_DEG: Final = 10.0
RARE: Final = 0.01
ENOUGH: Final = 100
MAX_SHOWN: Final = 3

CORNERS: Final = ("corner",)
MINIMA: Final = ("corner", "u_trap", "dead_end", "spiral", "zigzag")


@dataclass(frozen=True, slots=True)
class Claim:
    """A claim of the paper and its verdict.

    `shown` names the trials that decide it, by world, seed and noise or by their id.
    """

    statement: str
    rule: str
    evidence: str
    shown: str
    verdict: str


def claims(trials: Trials, runs: PaperRuns) -> list[Claim]:
    """Evaluate all claims on trials of a study, which may be none, and drives of the figures."""
    return [
        _path(runs),
        _return(runs, ("vgm",), "vgm returns to the original path, then reaches the goal", True),
        _return(runs, BUGS, "bug does not return to the original path", False),
        _heading(runs, ("vgm",), "vgm has kept its orientation when it reaches the goal", True),
        _heading(runs, BUGS, "bug reaches the goal first and only then orients itself", False),
        _corner(trials, runs),
        _always(
            "vgm does not get stuck in corners, avoids local minima, gets past obstacles "
            "“whatever the shape and size … under any circumstances”",
            _in_minima(trials, runs),
            ARRIVALS,
        ),
        _always(
            "vgm “guarantees that the robot will reach any reachable goal”",
            _of_vgm(trials, runs),
            ARRIVALS,
        ),
        _always(
            "vgm gets to the goal “without colliding with any obstacle”",
            _of_vgm(trials, runs),
            CLEAN,
        ),
        _dominant(trials),
    ]  # fmt: skip


class ClaimMeasure(NamedTuple):
    """A property that is counted over rows and drives."""

    what: str
    of_rows: Callable[[Trials], Flags]
    of_drive: Callable[[DrivenTrial], bool]


def _clean(some: Trials) -> Flags:
    found: Flags = some.numbers("contacts") == 0.0
    return found


ARRIVALS: Final = ClaimMeasure(
    "arrivals without contact", lambda some: some.success, arrived_untouched
)
CLEAN: Final = ClaimMeasure("drives without contact", _clean, lambda one: not one.outcome.contacts)

Evidence: TypeAlias = tuple[Trials, Sequence[DrivenTrial]]


def _of_vgm(trials: Trials, runs: PaperRuns) -> Evidence:
    every = (*runs.figures, *runs.traps)
    return trials.of(navigator="vgm"), [one for one in every if one.trial.navigator == "vgm"]


def _in_minima(trials: Trials, runs: PaperRuns) -> Evidence:
    """Return vgm's trials in these families, and its drives in the shipped traps."""
    drives = [trap for trap in runs.traps if trap.trial.navigator == "vgm"]
    return _of_families(trials.of(navigator="vgm"), MINIMA), drives


def _of_families(trials: Trials, families: Sequence[str]) -> Trials:
    chosen = trials.has(family="")
    for family in families:
        chosen = chosen | trials.has(family=family)
    return trials.where(chosen)


def _agreed(verdicts: Iterable[str]) -> str:
    found = set(verdicts)
    return found.pop() if len(found) == 1 else UNCLEAR


def _beyond(values: Sequence[float], limit: float, confirms: bool) -> tuple[str, str]:
    """Return the verdict on the median, and the median as text.

    `confirms`: a median below the limit confirms the claim, otherwise one above it. A limit within
    the interval leaves it unclear.
    """
    low, high = span = quantile_interval(values, 0.5)
    text = f"{number(quantile(values, 0.5))} {interval(span)}, {len(values)} drives"
    if high <= limit:
        return (CONFIRMED if confirms else REFUTED), text
    if low > limit:
        return (REFUTED if confirms else CONFIRMED), text
    return UNCLEAR, text  # fmt: skip


def _path(runs: PaperRuns) -> Claim:
    found = {label: _beyond(path_ratios(runs, label, "vgm"), LONGER, False) for label in BUGS}
    return Claim(
        "“Bug algorithm cannot properly guide the robot … the path is not proper”",
        f"bug's path is more than {LONGER - 1:.0%} longer than vgm's, median over pairs in which "
        "both arrive; refuted when significantly not",
        "bug / vgm: " + _each(found),
        _batch(runs),
        _agreed(verdict for verdict, _ in found.values()),
    )


def _return(runs: PaperRuns, labels: Sequence[str], statement: str, wanted: bool) -> Claim:
    rule = (
        "deviation half way from the largest deviation to the goal, over the largest: returned "
        f"when the median is at most {RETURNED:g}; heading straight for the goal gives 0.5"
    )
    return _measured(runs, labels, statement, rule, remaining_deviation, RETURNED, wanted)


def _heading(runs: PaperRuns, labels: Sequence[str], statement: str, wanted: bool) -> Claim:
    rule = (
        "remaining turn on the spot at the goal, in degrees: oriented when the median is at most "
        f"{ORIENTED_DEG:g}"
    )
    return _measured(runs, labels, statement, rule, remaining_turn_deg, ORIENTED_DEG, wanted)


def _measured(
    runs: PaperRuns,
    labels: Sequence[str],
    statement: str,
    rule: str,
    measure: Callable[[DrivenTrial], float | None],
    limit: float,
    wanted: bool,
) -> Claim:
    found: dict[str, tuple[str, str]] = {}
    for label in labels:
        values = [value for drive in runs.of(label) if (value := measure(drive)) is not None]
        found[label] = _beyond(values, limit, wanted)
    verdict = _agreed(verdict for verdict, _ in found.values())
    return Claim(statement, rule, _each(found), _batch(runs), verdict)


def _each(found: dict[str, tuple[str, str]]) -> str:
    return "; ".join(f"{label}: {text}" for label, (_, text) in found.items())


def _corner(trials: Trials, runs: PaperRuns) -> Claim:
    """Evaluate a claim of never, per side."""
    verdicts, texts, shown = [], [], []
    for side in ("left", "right"):
        rows = _of_families(trials.of(navigator="bug", side=side), CORNERS)
        drives = [
            trap
            for trap in runs.traps
            if trap.trial.world.name in CORNERS
            and (trap.trial.navigator, trap.trial.side) == ("bug", side)
        ]
        found = _pooled((rows, drives), ARRIVALS)
        verdicts.append(_universal(Proportion(found.of - found.count, found.of)))
        texts.append(f"bug, {side}: {share(found)} % of {count_text(found.of)} arrive")
        shown += [f"{side}: {one}" for one in _shown((rows, drives), ARRIVALS, True)]
    return Claim(
        "bug “cannot avoid obstacles with corners … gets stuck and never reaches the goal”",
        f"arrivals in corners: confirmed when there is none in at least {ENOUGH} trials, refuted "
        f"when their share is significantly above {RARE:.0%}",
        "; ".join(texts),
        "arrivals: " + ", ".join(shown) if shown else "",
        _agreed(verdicts),
    )


def _always(statement: str, pool: Evidence, kind: ClaimMeasure) -> Claim:
    """Evaluate a claim of always, in worlds with a path to the goal."""
    rows, drives = pool
    chosen = rows.where(rows.possible), drives
    found, against = _pooled(chosen, kind), _shown(chosen, kind, False)
    return Claim(
        statement,
        f"{kind.what}: confirmed when there is nothing else in at least {ENOUGH} trials, refuted "
        f"when their share is significantly below {1 - RARE:.0%}",
        f"{share(found)} % of {count_text(found.of)}",
        "counterexamples: " + ", ".join(against) if against else "",
        _universal(found),
    )


def _universal(found: Proportion) -> str:
    if found.interval.high < 1.0 - RARE:
        return REFUTED
    return CONFIRMED if found.count == found.of and found.of >= ENOUGH else UNCLEAR


def _pooled(pool: Evidence, kind: ClaimMeasure) -> Proportion:
    rows, drives = pool
    good = rows.count(kind.of_rows(rows)) + sum(map(kind.of_drive, drives))
    return Proportion(good, len(rows) + len(drives))


def _shown(pool: Evidence, kind: ClaimMeasure, good: bool) -> list[str]:
    """Return a few trials for which the measure is true, or false, from both sources."""
    rows, drives = pool
    found = [
        f"{drive.trial.world.name} {drive.outcome.noise} seed {drive.trial.seed}"
        for drive in drives
        if kind.of_drive(drive) == good
    ]
    picked = rows.where(kind.of_rows(rows) == good)
    named = zip(
        *(picked.texts(name).tolist() for name in ("world", "noise", "trial_id")),
        picked.numbers("seed").tolist(),
        strict=True,
    )
    ids = [f"{world} {noise} seed {seed:.0f} (`{id_[:12]}`)" for world, noise, id_, seed in named]
    return found[:MAX_SHOWN] + sorted(ids)[:MAX_SHOWN]


def _dominant(trials: Trials) -> Claim:
    """Compare vgm with both sides of bug on the same worlds, noise and seeds."""
    reachable = trials.where(trials.possible)
    vgm = "vgm", runs_by_pair(reachable.of(navigator="vgm"))
    texts, verdicts = [], []
    for side in ("left", "right"):
        bug = f"bug, {side}", runs_by_pair(reachable.of(navigator="bug", side=side))
        found = comparison("", vgm, bug)
        lead = found.worlds_first - found.worlds_second
        sure = found.p_worlds < LEVEL
        verdicts.append((CONFIRMED if lead > 0 else REFUTED) if sure else UNCLEAR)
        texts.append(
            f"against bug, {side}: vgm alone succeeds in {found.only_first}, bug alone in "
            f"{found.only_second} of {count_text(found.pairs)} pairs; better in"
            f" {found.worlds_first} : {found.worlds_second} worlds, p {probability(found.p_worlds)}"
        )
    return Claim(
        "vgm “is dominant over Bug algorithm”, “more reliable”",
        "successes in the same worlds at the same noise and seed: better in more worlds, sign "
        f"test, p < {LEVEL:g}, against bug on either side",
        "; ".join(texts),
        "all trials of vgm and bug in this study",
        _agreed(verdicts),
    )


def _batch(runs: PaperRuns) -> str:
    """Describe the trials of the paper's figures."""
    worlds = dict.fromkeys(drive.trial.world.name for drive in runs.figures)
    seeds = {drive.trial.seed for drive in runs.figures}
    if not seeds:
        return ""
    noises = ", ".join(dict.fromkeys(drive.outcome.noise for drive in runs.figures))
    return f"{' and '.join(worlds)}, noise {noises}, seeds {min(seeds)} to {max(seeds)}"


WIDTH: Final = 520.0
DRAWN_SEEDS: Final = 5
TONES: Final = {CONFIRMED: "good", REFUTED: "bad", UNCLEAR: "open"}
FIGURES: Final = (
    ("11", "paper_fig11", ("vgm", "vgm_memory"), "the virtual goal method"),
    ("12", "paper_fig12", ("bug, left", "bug, right"), "the Bug algorithm"),
    ("13", "paper_fig13", ("bug, left", "bug, right", "vgm", "vgm_memory"), "the results"),
)


def paper_section(trials: Trials, runs: PaperRuns) -> PageSection:
    """Return the section on the paper's figures and claims."""
    found = claims(trials, runs)
    parts = (
        PageSection("Claims", (claims_table(found),)),
        PageSection(
            "Figures 11, 12 and 13", (Paragraph(HOW_RUN), *_figures(runs), _runs_table(runs))
        ),
    )
    return PageSection("The paper's figures and claims", (Paragraph(READING),), parts)


READING: Final = (
    "The paper shows vgm and bug in one place each (figures 11 and 12) and both results side by "
    "side (figure 13). It gives no dimensions and no numbers, so the worlds are our own. Its "
    "claims are evaluated by rules that were fixed before the trials were run. `vgm` and `bug` are "
    "the paper's methods with corrected signs and without memory."
)
HOW_RUN: Final = (
    f"Thick: without noise. Thin: the first {DRAWN_SEEDS} seeds at every noise level; the table "
    "below counts all seeds. Dashed: bug passing on the right; the straight dashed line joins "
    "start and goal. Figures 11 and 12 show the same place, so that their drives can be compared "
    "in pairs."
)


def claims_table(found: list[Claim]) -> PageTable:
    """Return the table of the paper's claims."""
    rows = tuple(
        (
            one.statement,
            PageCell(f"**{one.verdict}**", TONES[one.verdict]),
            *(one.evidence, one.rule, one.shown),
        )
        for one in found
    )
    caption = (
        f"The paper's claims and the results of the trials. In brackets {CONFIDENT} intervals: "
        "Wilson's for shares in percent, order statistics for medians."
    )
    head = ("the paper's claim", "verdict", "evidence", "rule", "trials")
    return PageTable(caption, head, rows, names=5)


def _figures(runs: PaperRuns) -> tuple[Block, ...]:
    if not runs.figures:
        return (Paragraph("They were not run for this report."),)
    return (Gallery(tuple(_figure(runs, *figure) for figure in FIGURES)),)


def _figure(
    runs: PaperRuns, figure: str, name: str, labels: tuple[str, ...], shows: str
) -> PageFigure:
    place = next(world for figures, world in PLACES.items() if figure in figures)
    drives = [
        drive
        for label in labels
        for drive in runs.of(label)
        if drive.trial.world.name == place
    ]  # fmt: skip
    ends = Proportion(sum(map(arrived_untouched, drives)), len(drives))
    title = f"Figure {figure} redone: {' and '.join(labels)}, {ends.count} of {ends.of} arrive"
    plan = WorldMap(load(name), WIDTH, title)
    plan.straight()
    for faint in (True, False):
        for drive in drives:
            if (drive.outcome.noise != "none") == faint and drive.trial.seed < DRAWN_SEEDS:
                plan.add(drive, faint=faint)
    plan.ends()
    plan.legend(labels)
    caption = f"**Figure {figure}**, {shows}: {ends.count} of {ends.of} drives arrive."
    command = (
        f"sidestep trial --world {name} --navigator {labels[0].partition(',')[0]} --noise none"
    )
    return PageFigure(f"paper-figure-{figure}", plan.drawing, caption, code=command)


def _runs_table(runs: PaperRuns) -> PageTable:
    rows = []
    for figures, place in PLACES.items():
        for label in dict.fromkeys(label_of(drive) for drive in runs.figures):
            for noise in LEVELS:
                some = [
                    drive
                    for drive in runs.of(label)
                    if (drive.trial.world.name, drive.outcome.noise) == (place, noise)
                ]
                if some:
                    rows.append((figures, label, noise, *_measures(some)))
    head = (
        *("figure", "navigator", "noise", "arrives %", "path / shortest"),
        *("largest deviation m", "deviation left half way", "remaining turn at the goal deg"),
    )
    caption = (
        "Medians over the drives of these figures. Half way from the largest deviation to the "
        "goal, 0 means back on the straight line and 0.5 straight towards the goal."
    )
    return PageTable(caption, head, tuple(rows), names=3)


def _measures(drives: list[DrivenTrial]) -> tuple[str, ...]:
    arrivals = [drive for drive in drives if drive.outcome.reached]
    ratios = [
        drive.outcome.path_m / drive.outcome.shortest_path_m
        for drive in arrivals
        if drive.outcome.shortest_path_m
    ]
    left = [value for drive in arrivals if (value := remaining_deviation(drive)) is not None]
    turns = [value for drive in arrivals if (value := remaining_turn_deg(drive)) is not None]
    return (
        share(Proportion(sum(map(arrived_untouched, drives)), len(drives)), 0),
        number(quantile(ratios, 0.5)),
        number(quantile([deviation_m(drive) for drive in drives], 0.5)),
        number(quantile(left, 0.5)),
        number(quantile(turns, 0.5), 1),
    )
