"""Figures 11, 12 and 13 of the paper redone, beside its claims."""

from typing import Final

from plant.model.noise import LEVELS
from plant.world.file import load
from study.report.charts.drives import Drive
from study.report.charts.world_map import Map
from study.report.page import Block, Cell, Figure, Gallery, Section, Table, Text
from study.report.paper.claims import CONFIRMED, REFUTED, UNCLEAR, Claim, claims
from study.report.paper.runs import (
    PLACES,
    Runs,
    deviation_m,
    label_of,
    left_of_deviation,
    turn_left_deg,
    untouched,
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


def paper_section(trials: Trials, runs: Runs) -> Section:
    found = claims(trials, runs)
    parts = (
        Section("Claims", (claims_table(found),)),
        Section("Figures 11, 12 and 13", (Text(HOW_RUN), *_figures(runs), _runs_table(runs))),
    )
    return Section("The paper's figures and claims", (Text(READING),), parts)


READING: Final = (
    "The paper shows vgm and bug in one place each (figures 11 and 12) and both results side by "
    "side (figure 13); it gives no sizes and no numbers, so the worlds are ours. What it claims is "
    "judged by rules that were written down before the trials were run. `vgm` and `bug` are the "
    "paper's, with the signs put right and without memory."
)
HOW_RUN: Final = (
    f"Thick: without noise. Thin: the first {DRAWN_SEEDS} seeds at every noise level; all seeds "
    "are counted, in the table below. Dashed: bug passing on the right; the straight dashes are "
    "the line from start to goal. Figures 11 and 12 show the same "
    "place, so that their drives can be compared pair by pair."
)


def claims_table(found: list[Claim]) -> Table:
    rows = tuple(
        (
            one.says,
            Cell(f"**{one.verdict}**", TONES[one.verdict]),
            *(one.evidence, one.rule, one.shown),
        )
        for one in found
    )
    caption = (
        "What the paper claims, and what the trials say. "
        f"In brackets {CONFIDENT} intervals: Wilson's for "
        "shares in percent, order statistics for medians."
    )
    head = ("the paper's claim", "verdict", "evidence", "rule", "trials")
    return Table(caption, head, rows, names=5)


def _figures(runs: Runs) -> tuple[Block, ...]:
    if not runs.figures:
        return (Text("They were not run again for this report."),)
    return (Gallery(tuple(_figure(runs, *figure) for figure in FIGURES)),)


def _figure(runs: Runs, figure: str, name: str, labels: tuple[str, ...], shows: str) -> Figure:
    place = next(world for figures, world in PLACES.items() if figure in figures)
    drives = [
        drive
        for label in labels
        for drive in runs.of(label)
        if drive.trial.world.name == place
    ]  # fmt: skip
    ends = Share(sum(map(untouched, drives)), len(drives))
    says = f"Figure {figure} redone: {' and '.join(labels)}, {ends.count} of {ends.of} arrive"
    plan = Map(load(name), WIDTH, says)
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
    return Figure(f"paper-figure-{figure}", plan.drawing, caption, code=command)


def _runs_table(runs: Runs) -> Table:
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
        *("figure", "navigator", "noise", "arrives %", "way / shortest"),
        *("largest deviation m", "of it left half way to the goal", "left to turn at the goal deg"),
    )
    caption = (
        "The drives of these figures, medians. Half way from the largest deviation to the goal, 0 "
        "means back on the straight line and 0.5 straight towards the goal."
    )
    return Table(caption, head, tuple(rows), names=3)


def _measures(drives: list[Drive]) -> tuple[str, ...]:
    there = [drive for drive in drives if drive.outcome.reached]
    ratios = [
        drive.outcome.path_m / drive.outcome.shortest_path_m
        for drive in there
        if drive.outcome.shortest_path_m
    ]
    left = [value for drive in there if (value := left_of_deviation(drive)) is not None]
    turns = [value for drive in there if (value := turn_left_deg(drive)) is not None]
    return (
        share(Share(sum(map(untouched, drives)), len(drives)), 0),
        number(quantile(ratios, 0.5)),
        number(quantile([deviation_m(drive) for drive in drives], 0.5)),
        number(quantile(left, 0.5)),
        number(quantile(turns, 0.5), 1),
    )
