"""Build the page of the report from a table of trials.

It opens with the verdict, in sentences with their figures, and ends with the run itself, so that a
reader can repeat it.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import isfinite
from typing import Final

import numpy as np
import pyarrow as pa

from protocol.world import World
from runtime.errors import UserError
from study.report.comparisons import (
    LEVEL,
    PairedComparison,
    bounds_section,
    comparison_table,
    comparisons,
)
from study.report.drives import PaperRuns
from study.report.evidence import MeasuredEvidence
from study.report.gallery import PER_NAVIGATOR, WorldOf, gallery, selected_failures
from study.report.page import (
    DASH,
    Block,
    CodeBlock,
    PageCell,
    PageCellLike,
    PageSection,
    PageTable,
    Paragraph,
    ReportPage,
    count_text,
    number,
    percent,
    probability,
    share,
)
from study.report.paper import paper_section
from study.report.summary import (
    NavigatorSummary,
    behaviour_blocks,
    ends_figure,
    error_figure,
    error_table,
    given_up_table,
    main_table,
    more_table,
    ratio_figure,
    success_figure,
    summaries,
)
from study.report.targets import MET, MISSED, StudyTarget, target_table, targets
from study.report.trials import (
    CORPUS,
    CROWDS,
    GRIDS,
    NOTES,
    PLANNER,
    THIN,
    Trials,
    apart_of,
    distinct,
    in_group,
    main_of,
    trials_of,
)
from study.runner.plan import OwnFile
from study.runner.rows import FAILED
from study.trial.trial import ALL_NAVIGATORS


def family_table(trials: Trials, noise: str) -> PageTable:
    """Return success by family at one noise level, coloured from warm (0) to cool (1)."""
    chosen = trials.of(noise=noise)
    labels = chosen.labels()
    rows = []
    for family in chosen.values("family"):
        some = chosen.of(family=family)
        rows.append(
            (family, count_text(some.worlds), *(_cell(some.of(label=label)) for label in labels))
        )
    caption = (
        f"Noise `{noise}`: success in percent by family; in `unreachable`, success is to report "
        "it. In brackets: successes / trials."
    )
    return PageTable(caption, ("family", "worlds", *labels), tuple(rows))


def _cell(trials: Trials) -> PageCellLike:
    if not len(trials):
        return PageCell(DASH, "none")
    found = trials.share(trials.success)
    return PageCell(f"{percent(found.rate, 0)} ({found.count}/{found.of})", heat=found.rate)


SHOWN: Final = 6


def _family_count(count: int) -> str:
    return "1 family" if count == 1 else f"{count} families"


def how_run(trials: Trials, kept: int, command: str) -> tuple[Block, ...]:
    """Describe all rows, of which `kept` are distinct drives."""
    lead = Paragraph(
        f"{count_text(len(trials))} trials in {count_text(trials.worlds)} "
        f"worlds of {_family_count(len(trials.values('family')))}, "
        f"{number(_sum(trials, 'time_s') / 3600.0, 1)} simulated hours in "
        f"{number(_sum(trials, 'cpu_s') / 3600.0, 2)} hours of processor time."
    )
    rows = tuple((name, text) for name, text in _facts(trials, kept).items())
    caption = "Trials, code and machine."
    table = PageTable(caption, ("", ""), rows, names=2)
    return (lead, CodeBlock(command), table) if command else (lead, table)


def _facts(trials: Trials, kept: int) -> Mapping[str, str]:
    facts = {
        "study": _all(trials, "study"),
        "navigators": "; ".join(trials.labels()),
        "noise": _all(trials, "noise"),
        "seeds": _seeds(trials),
        "parameters": _all(trials, "parameters"),
        "calibrated": _flag(trials, "calibrated"),
        "code": f"commit {_commits(trials)}; uncommitted changes: {_flag(trials, 'dirty')}",
        "version": _all(trials, "version"),
        "Python": _all(trials, "python"),
        "numpy, pymunk": f"{_all(trials, 'numpy')}, {_all(trials, 'pymunk')}",
        "platform": _all(trials, "platform"),
        "processor": _all(trials, "machine"),
        "run": _times(trials),
    }
    if kept != len(trials):
        facts["repetitions"] = (
            f"{count_text(len(trials) - kept)} trials are bit-identical to another one, as all"
            " seeds are without noise; each drive is counted once"
        )
    failed = trials.count(trials.has(outcome=FAILED))
    if failed:
        facts["failed"] = f"{count_text(failed)} trials could not be run; none counts as a success"
    strange = [name for name in trials.values("navigator") if name not in ALL_NAVIGATORS]
    if strange:
        facts["unknown here"] = ", ".join(strange)
    return facts


def _sum(trials: Trials, name: str) -> float:
    return float(np.nansum(trials.numbers(name)))


def _all(trials: Trials, name: str) -> str:
    found = [value for value in trials.values(name) if value]
    more = f" and {len(found) - SHOWN} more" if len(found) > SHOWN else ""
    return ", ".join(found[:SHOWN]) + more or "-"


def _commits(trials: Trials) -> str:
    return ", ".join(commit[:12] for commit in trials.values("commit")[:SHOWN] if commit) or "-"


def _flag(trials: Trials, name: str) -> str:
    words = {0.0: "no", 1.0: "yes"}
    found = sorted({words[value] for value in trials.numbers(name).tolist() if isfinite(value)})
    return " and ".join(found) or "-"


def _seeds(trials: Trials) -> str:
    found = sorted({int(seed) for seed in trials.numbers("seed").tolist() if isfinite(seed)})
    if found == list(range(len(found))) and len(found) > 1:
        return f"0 to {len(found) - 1}"
    return ", ".join(map(str, found[:SHOWN])) + (" …" if len(found) > SHOWN else "") or "-"


def _times(trials: Trials) -> str:
    found = [time for time in trials.values("started_utc") if time]
    return f"{found[0]} to {found[-1]} (UTC)" if found else "-"


PAPER: Final = ("bug", "vgm")
"""The navigators that the paper compares, the older one first."""


def verdict(
    trials: Trials, found: list[NavigatorSummary], wanted: list[StudyTarget]
) -> PageSection:
    """Return the section; every verdict is by worlds, at each noise level of the study."""
    sentences: list[str] = []
    for noise in trials.values("noise"):
        rows = sorted(
            (one for one in found if (one.noise, one.label != PLANNER) == (noise, True)),
            key=lambda one: -one.success.rate,
        )
        tests = comparisons(trials, noise)
        rows = [one for one in rows if one.success.of]
        sentences += [*best(rows, noise, tests), *paper(tests), *touched(rows)]
    return PageSection("Verdict", (*map(Paragraph, sentences), *reached(wanted)))


def best(rows: list[NavigatorSummary], noise: str, tests: list[PairedComparison]) -> list[str]:
    """Say which navigator arrives most often, or which ones no test by worlds tells apart."""
    if not rows:
        return [f"Noise `{noise}`: no trial has a path to its goal."]
    first, *others = rows
    if not others:
        return [f"Noise `{noise}`: {of_trials(first)}."]
    ties = [one for one in others if not differs(first, one, tests)]
    if not ties:
        return [
            f"Noise `{noise}`: **{first.label} arrives most often**, {of_trials(first)}. Next is"
            f" {of_trials(others[0])}."
        ]
    names = "; ".join(map(of_trials, (first, *ties)))
    return [f"Noise `{noise}`: **a tie**, which no test by worlds decides: {names}."]


def of_trials(one: NavigatorSummary) -> str:
    """Return how often a navigator arrives, with the worlds and trials behind it."""
    counts = f"{count_text(one.success.of)} trials in {count_text(one.reachable_worlds)} worlds"
    return f"{one.label} in {share(one.success)} % of {counts} with a path"


def differs(one: NavigatorSummary, other: NavigatorSummary, tests: list[PairedComparison]) -> bool:
    """Return whether the test by worlds tells two navigators apart."""
    pair = {one.label, other.label}
    return any({test.first, test.second} == pair and test.p_worlds < LEVEL for test in tests)


def paper(tests: list[PairedComparison]) -> list[str]:
    """Say whether the paper's two navigators differ, for each side of the older one."""
    return [
        in_words(one)
        for one in tests
        if {one.first.partition(",")[0], one.second.partition(",")[0]} == set(PAPER)
    ]


def in_words(one: PairedComparison) -> str:
    """Return a comparison as a sentence."""
    names, better_in = (one.first, one.second), (one.worlds_first, one.worlds_second)
    p = f"p = {probability(one.p_worlds)}".replace("= <", "<")
    cases = f"{names[0]} succeeds more often in {better_in[0]}, {names[1]} in {better_in[1]}"
    worlds = f"of {count_text(one.worlds)} worlds {cases} ({p} by worlds)"
    if one.p_worlds >= LEVEL or better_in[0] == better_in[1]:
        return (
            f"The study shows **no clear difference** between {names[0]} and {names[1]}: {worlds}."
        )
    better = names[0] if better_in[0] > better_in[1] else names[1]
    worse = names[1] if better == names[0] else names[0]
    return f"**{better} succeeds more often than {worse}**: {worlds}."


def touched(rows: list[NavigatorSummary]) -> list[str]:
    """Say which navigator touched something least and most often, unless the intervals overlap."""
    if len(rows) < 2:
        return []
    least, *_, most = sorted(rows, key=lambda one: one.touched.rate)
    if not most.touched.rate:
        return [f"With noise `{most.noise}` none of these navigators touched anything."]
    if least.touched.interval.high >= most.touched.interval.low:
        rates = dict.fromkeys(percent(one.touched.rate, 2) for one in (least, most))
        return [
            f"Something was touched in {' to '.join(rates)} % of trials: a tie, as the intervals"
            " overlap."
        ]
    return [
        f"Something was touched least often by {least.label} ({share(least.touched, 2)} % of"
        f" trials), most often by {most.label} ({share(most.touched, 2)} %)."
    ]


def reached(wanted: list[StudyTarget]) -> tuple[Block, ...]:
    """Say how many of the figures to reach are met, and list those that are missed."""
    judged = [one for one in wanted if one.verdict in (MET, MISSED)]
    missed = [one for one in judged if one.verdict == MISSED]
    if not judged:
        return ()
    met = Paragraph(f"{len(judged) - len(missed)} of {len(judged)} figures to reach are met.")
    rows = tuple((one.what, one.noise, one.wanted, one.measured) for one in missed)
    head = ("what", "noise", "wanted", "measured")
    return (met, PageTable("Figures that are missed.", head, rows, names=2)) if rows else (met,)


TITLE = "Comparison of the navigators"


def no_world(source: str) -> World:
    """Raise UserError: the report has no source of worlds."""
    raise UserError(f"world {source}: this report was requested without its worlds")


@dataclass(frozen=True, slots=True, kw_only=True)
class ReportRequest:
    """Inputs of a report besides its trials.

    `runs` are drives of the paper's figures, whose section is left out without any. With the
    `evidence` of other tools the project judges its own navigator by its figures to reach; without
    it nothing is judged by them.
    """

    command: str = ""
    runs: PaperRuns = field(default_factory=PaperRuns)
    world_of: WorldOf = no_world
    failures: int = PER_NAVIGATOR
    jobs: int = 1
    evidence: MeasuredEvidence | None = None
    own: Mapping[str, OwnFile] = field(default_factory=dict)
    """The user's own navigators by name."""

    def targets(self, trials: Trials) -> list[StudyTarget]:
        """Return the project's own targets, if the study is to be judged by them."""
        return [] if self.evidence is None else targets(trials, self.evidence)


def page_of(table: pa.Table, request: ReportRequest) -> ReportPage:
    """Return the page of a study."""
    every = trials_of(table)
    whole = distinct(every)
    size, *origin = how_run(every, len(whole), request.command)
    trials, apart = main_of(whole), apart_of(whole)
    on_paper = (paper_section(trials, request.runs),) if request.runs.figures else ()
    if not len(whole):
        nothing = Paragraph("**There is no trial in this study**, so there is nothing to compare.")
        return ReportPage(TITLE, (nothing,), on_paper)
    found, wanted = summaries(trials), request.targets(whole)
    sections = (
        verdict(trials, found, wanted),
        _summary(trials, found),
        *((PageSection("Figures to reach", (target_table(wanted),)),) if wanted else ()),
        _families(trials),
        *((_apart(apart),) if apart else ()),
        _comparisons(trials),
        PageSection("Final pose", (error_figure(trials), error_table(trials))),
        PageSection("Path length", (ratio_figure(trials),)),
        *_bounds(trials),
        PageSection("Decisions and behaviour", behaviour_blocks(trials)),
        *on_paper,
        _failures(table, in_group(whole, *SHOWN_FAILURES), request),
        PageSection("Definitions", (Paragraph(READING), Paragraph(SEEDS))),
        PageSection("How it was run", tuple(origin)),
    )
    return ReportPage(TITLE, (size,), sections)


SHOWN_FAILURES: Final = (CORPUS, GRIDS, THIN, CROWDS)
"""Failures in adversarial worlds are the rule, and their pages show them."""


READING = (
    "A trial is a success when the robot reached the goal by its own estimate and touched nothing, "
    "including obstacles that moved into it; where there is no path to the goal, when it reported "
    "so. `lost`, `stuck`, `timeout`, `collided`, `aborted` and failed trials are not successes. "
    "`unreachable` claims a proof, `lost` claims nothing, `stuck` cannot move. The true "
    "error is the true distance from the goal, which depends on drift more than on the navigator. "
    "The shortest path is that of a disc of the robot's radius in a known map."
)
SEEDS = (
    "Several seeds of one world are not independent trials. So every verdict and test is by "
    "worlds, and the intervals of shares are Wilson's for as many independent trials as these, "
    "clustered by world, tell (Kish's design effect). Where all trials end alike, each world "
    "counts once."
)


def _summary(trials: Trials, found: list[NavigatorSummary]) -> PageSection:
    figures: tuple[Block, ...] = (success_figure(found), main_table(found), more_table(found))
    return PageSection("Summary", (*figures, given_up_table(trials), ends_figure(trials)))


def _apart(apart: Mapping[str, Trials]) -> PageSection:
    """Return the section of the groups of worlds that are not of the corpus."""
    parts = tuple(
        PageSection(
            group[0].upper() + group[1:],
            (
                Paragraph(NOTES[group]),
                main_table(summaries(trials)),
                given_up_table(trials),
                *(family_table(trials, noise) for noise in trials.values("noise")),
            ),
        )
        for group, trials in apart.items()
    )
    words = "These worlds are not in the tables above, nor in the comparisons and figures below."
    return PageSection("Worlds apart from the corpus", (Paragraph(words),), parts)


def _failures(table: pa.Table, trials: Trials, request: ReportRequest) -> PageSection:
    failures = selected_failures(table, trials, request.failures)
    return gallery(failures, request.world_of, request.jobs, request.own)


def _families(trials: Trials) -> PageSection:
    tables = tuple(family_table(trials, noise) for noise in trials.values("noise"))
    return PageSection("Families of worlds", tables)


def _bounds(trials: Trials) -> tuple[PageSection, ...]:
    section = bounds_section(trials)
    return () if section is None else (section,)


def _comparisons(trials: Trials) -> PageSection:
    blocks: list[Block] = []
    for noise in trials.values("noise"):
        found = comparisons(trials, noise)
        if found:
            blocks.append(comparison_table(found, noise))
    if not blocks:
        blocks = [
            Paragraph("No two navigators drove in the same worlds, so there is no comparison.")
        ]
    return PageSection("Pairwise comparisons", tuple(blocks))
