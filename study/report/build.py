"""Build the page of the report from a table of trials."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

import pyarrow as pa

from plant.model.types import World
from runtime.errors import UserError
from study.report.bounds import bounds_section
from study.report.charts.distributions import (
    behaviour_blocks,
    ends_figure,
    error_figure,
    error_table,
    ratio_figure,
    success_figure,
)
from study.report.charts.gallery import PER_NAVIGATOR, WorldOf, gallery, selected_failures
from study.report.comparisons import comparison_table, comparisons
from study.report.families import family_table
from study.report.given_up import given_up_table
from study.report.groups import CORPUS, CROWDS, GRIDS, NOTES, THIN, apart_of, in_group, main_of
from study.report.how_run import how_run
from study.report.page import Block, Paragraph, ReportPage, Section
from study.report.paper.evidence import Evidence
from study.report.paper.runs import PaperRuns
from study.report.paper.section import paper_section
from study.report.paper.targets import target_table, targets
from study.report.summary import Summary, main_table, more_table, summaries
from study.report.trials import Trials, distinct, trials_of
from study.report.verdict import verdict

TITLE = "Comparison of the navigators"


def no_world(source: str) -> World:
    """Raise UserError: the report has no source of worlds."""
    raise UserError(f"world {source}: this report was requested without its worlds")


@dataclass(frozen=True, slots=True, kw_only=True)
class ReportRequest:
    """Inputs of a report besides its trials.

    `runs` of the paper's figures and `evidence` of other tools may be empty.
    """

    command: str = ""
    runs: PaperRuns = field(default_factory=PaperRuns)
    world_of: WorldOf = no_world
    failures: int = PER_NAVIGATOR
    jobs: int = 1
    evidence: Evidence = field(default_factory=Evidence)


def page_of(table: pa.Table, request: ReportRequest) -> ReportPage:
    """Return the page of a study."""
    every = trials_of(table)
    whole = distinct(every)
    size, *origin = how_run(every, len(whole), request.command)
    trials, apart = main_of(whole), apart_of(whole)
    found, wanted = (
        (summaries(trials), targets(whole, request.evidence)) if len(whole) else ([], [])
    )
    if not len(whole):
        nothing = Paragraph("**There is no trial in this study**, so there is nothing to compare.")
        return ReportPage(TITLE, (nothing,), (paper_section(trials, request.runs),))
    sections = (
        verdict(trials, found, wanted),
        _summary(trials, found),
        Section("Figures to reach", (target_table(wanted),)),
        _families(trials),
        *((_apart(apart),) if apart else ()),
        _comparisons(trials),
        Section("Final pose", (error_figure(trials), error_table(trials))),
        Section("Path length", (ratio_figure(trials),)),
        *_bounds(trials),
        Section("Decisions and behaviour", behaviour_blocks(trials)),
        paper_section(trials, request.runs),
        _failures(table, in_group(whole, *SHOWN_FAILURES), request),
        Section("Definitions", (Paragraph(READING), Paragraph(SEEDS))),
        Section("How it was run", tuple(origin)),
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
    "Several seeds of one world are not independent trials of independent worlds: Wilson's "
    "intervals are valid for these worlds only. The tests by worlds allow for this."
)


def _summary(trials: Trials, found: list[Summary]) -> Section:
    figures: tuple[Block, ...] = (success_figure(found), main_table(found), more_table(found))
    return Section("Summary", (*figures, given_up_table(trials), ends_figure(trials)))


def _apart(apart: Mapping[str, Trials]) -> Section:
    """Return the section of the groups of worlds that are not of the corpus."""
    parts = tuple(
        Section(
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
    return Section("Worlds apart from the corpus", (Paragraph(words),), parts)


def _failures(table: pa.Table, trials: Trials, request: ReportRequest) -> Section:
    failures = selected_failures(table, trials, request.failures)
    return gallery(failures, request.world_of, request.jobs)


def _families(trials: Trials) -> Section:
    tables = tuple(family_table(trials, noise) for noise in trials.values("noise"))
    return Section("Families of worlds", tables)


def _bounds(trials: Trials) -> tuple[Section, ...]:
    section = bounds_section(trials)
    return () if section is None else (section,)


def _comparisons(trials: Trials) -> Section:
    blocks: list[Block] = []
    for noise in trials.values("noise"):
        found = comparisons(trials, noise)
        if found:
            blocks.append(comparison_table(found, noise))
    if not blocks:
        blocks = [
            Paragraph("No two navigators drove in the same worlds, so there is no comparison.")
        ]
    return Section("Pairwise comparisons", tuple(blocks))
