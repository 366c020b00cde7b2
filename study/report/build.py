"""The whole report of a table of trials, as a page."""

from dataclasses import dataclass, field

import pyarrow as pa

from plant.model.types import World
from runtime.errors import UserError
from study.report.charts.distributions import (
    behaviour_blocks,
    ends_figure,
    error_figure,
    error_table,
    ratio_figure,
    success_figure,
)
from study.report.charts.gallery import PER_NAVIGATOR, WorldOf, chosen, gallery
from study.report.comparisons import compared, comparison_table
from study.report.families import family_table
from study.report.how_run import how_run
from study.report.page import Block, Page, Section, Text
from study.report.paper.runs import Runs
from study.report.paper.section import paper_section
from study.report.paper.targets import targets, wanted_table
from study.report.summary import main_table, more_table, summaries
from study.report.trials import Trials, distinct, trials_of

TITLE = "How the navigators compare"


def no_world(source: str) -> World:
    raise UserError(f"world {source}: this report was asked for without its worlds")


@dataclass(frozen=True, slots=True, kw_only=True)
class ReportRequest:
    """What a report needs besides its trials; `runs` of the paper's figures, may be none."""

    command: str = ""
    runs: Runs = field(default_factory=Runs)
    world_of: WorldOf = no_world
    failures: int = PER_NAVIGATOR
    jobs: int = 1


def page_of(table: pa.Table, asked: ReportRequest) -> Page:
    every = trials_of(table)
    trials = distinct(every)
    lead = (*how_run(every, len(trials), asked.command),)
    if not len(trials):
        nothing = Text("**There is no trial in this study**, so there is nothing to compare.")
        return Page(TITLE, (nothing,), (paper_section(trials, asked.runs),))
    sections = (
        _summary(trials),
        Section("Figures to reach", (wanted_table(targets(trials)),)),
        _families(trials),
        _comparisons(trials),
        Section("Final pose", (error_figure(trials), error_table(trials))),
        Section("Length of the way", (ratio_figure(trials),)),
        Section("Decisions and behaviour", behaviour_blocks(trials)),
        paper_section(trials, asked.runs),
        gallery(chosen(table, trials, asked.failures), asked.world_of, asked.jobs),
        Section("How to read this", (Text(READING), Text(SEEDS))),
    )
    return Page(TITLE, lead, sections)


READING = (
    "A trial is a success when the robot arrived by its own belief and touched nothing, also not "
    "what moved into it; where there is no way to the goal, when it said so. `stuck`, `timeout`, "
    "`collided`, `aborted` and trials that failed are none. The true error says how far from the "
    "goal it stood in truth, which drift decides more than the navigator. The shortest way is that "
    "of a disc of the robot's radius in a known map."
)
SEEDS = (
    "Several seeds of one world are not independent trials of independent worlds: Wilson's "
    "intervals speak of these worlds. The tests by worlds allow for it."
)


def _summary(trials: Trials) -> Section:
    found = summaries(trials)
    figures: tuple[Block, ...] = (success_figure(found), main_table(found), more_table(found))
    return Section("Summary", (*figures, ends_figure(trials)))


def _families(trials: Trials) -> Section:
    tables = tuple(family_table(trials, noise) for noise in trials.values("noise"))
    return Section("Families of worlds", tables)


def _comparisons(trials: Trials) -> Section:
    blocks: list[Block] = []
    for noise in trials.values("noise"):
        found = compared(trials, noise)
        if found:
            blocks.append(comparison_table(found, noise))
    if not blocks:
        blocks = [Text("No two navigators drove in the same worlds, so there is no comparison.")]
    return Section("Comparisons in pairs", tuple(blocks))
