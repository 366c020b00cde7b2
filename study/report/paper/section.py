"""The section on the paper: figures 11, 12 and 13 redone, and its claims."""

from typing import Final

from plant.model.configuration import LEVELS
from plant.world.file import load
from study.report.charts.drives import DrivenTrial
from study.report.charts.world_map import WorldMap
from study.report.page import Block, Gallery, PageCell, PageFigure, PageTable, Paragraph, Section
from study.report.paper.claims import CONFIRMED, REFUTED, UNCLEAR, Claim, claims
from study.report.paper.runs import (
    PLACES,
    PaperRuns,
    arrived_untouched,
    deviation_m,
    label_of,
    remaining_deviation,
    remaining_turn_deg,
)
from study.report.trials import Trials
from study.report.words import number, share
from study.statistics.intervals import CONFIDENT, Share, quantile

WIDTH: Final = 520.0
DRAWN_SEEDS: Final = 5
TONES: Final = {CONFIRMED: "good", REFUTED: "bad", UNCLEAR: "open"}
FIGURES: Final = (
    ("11", "paper_fig11", ("vgm", "vgm_memory"), "the virtual goal method"),
    ("12", "paper_fig12", ("bug, left", "bug, right"), "the Bug algorithm"),
    ("13", "paper_fig13", ("bug, left", "bug, right", "vgm", "vgm_memory"), "the results"),
)


def paper_section(trials: Trials, runs: PaperRuns) -> Section:
    """Return the section on the paper's figures and claims."""
    found = claims(trials, runs)
    parts = (
        Section("Claims", (claims_table(found),)),
        Section("Figures 11, 12 and 13", (Paragraph(HOW_RUN), *_figures(runs), _runs_table(runs))),
    )
    return Section("The paper's figures and claims", (Paragraph(READING),), parts)


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
    ends = Share(sum(map(arrived_untouched, drives)), len(drives))
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
        share(Share(sum(map(arrived_untouched, drives)), len(drives)), 0),
        number(quantile(ratios, 0.5)),
        number(quantile([deviation_m(drive) for drive in drives], 0.5)),
        number(quantile(left, 0.5)),
        number(quantile(turns, 0.5), 1),
    )
