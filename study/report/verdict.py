"""The verdict that opens the report: what the study found, in sentences with their figures."""

from typing import Final

from study.report.comparisons import LEVEL, Comparison, comparisons
from study.report.groups import PLANNER
from study.report.page import Paragraph, Section
from study.report.paper.target import MET, MISSED, StudyTarget
from study.report.summary import Summary
from study.report.trials import Trials
from study.report.words import count, percent, probability, share

USUAL_NOISE: Final = "default"
PAPER: Final = ("bug", "vgm")
"""The navigators that the paper compares, the older one first."""


def verdict(trials: Trials, found: list[Summary], wanted: list[StudyTarget]) -> Section:
    """Return the section; it judges one noise level, the usual one if that was run."""
    noises = trials.values("noise")
    noise = USUAL_NOISE if USUAL_NOISE in noises else noises[0]
    rows = sorted(
        (one for one in found if one.noise == noise and one.success.of and one.label != PLANNER),
        key=lambda one: -one.success.rate,
    )
    sentences = [*best(rows, noise), *paper(trials, noise), *touched(rows), *reached(wanted)]
    return Section("Verdict", tuple(map(Paragraph, sentences)))


def best(rows: list[Summary], noise: str) -> list[str]:
    """Say which navigator arrives most often, and which comes next."""
    if not rows:
        return [f"No trial with `{noise}` noise has a path to its goal."]
    first, *others = rows
    lead = (
        f"**{first.label} arrives most often**: {share(first.success)} % of"
        f" {count(first.success.of)} trials in worlds with a path to the goal, `{noise}` noise."
    )
    if not others:
        return [lead]
    return [f"{lead} Next is {others[0].label} with {share(others[0].success)} %."]


def paper(trials: Trials, noise: str) -> list[str]:
    """Say whether the paper's two navigators differ, for each side of the older one."""
    found = comparisons(trials, noise)
    return [
        in_words(one)
        for one in found
        if {one.first.partition(",")[0], one.second.partition(",")[0]} == set(PAPER)
    ]


def in_words(one: Comparison) -> str:
    """Return a comparison as a sentence."""
    names, only = (one.first, one.second), (one.only_first, one.only_second)
    p = f"p = {probability(one.p_success)}".replace("= <", "<")
    cases = f"only {names[0]} succeeds in {only[0]}, only {names[1]} in {only[1]}"
    pairs = f"in {count(one.pairs)} pairs of trials {cases} ({p})"
    if one.p_success >= LEVEL or only[0] == only[1]:
        return (
            f"The study shows **no clear difference** between {names[0]} and {names[1]}: {pairs}."
        )
    better = names[0] if only[0] > only[1] else names[1]
    worse = names[1] if better == names[0] else names[0]
    return f"**{better} succeeds more often than {worse}**: {pairs}."


def touched(rows: list[Summary]) -> list[str]:
    """Say which navigator touched something least and most often."""
    if len(rows) < 2:
        return []
    least, *_, most = sorted(rows, key=lambda one: one.touched.rate)
    return [
        f"Something was touched least often by {least.label}"
        f" ({percent(least.touched.rate, 2)} % of trials), most often by {most.label}"
        f" ({percent(most.touched.rate, 2)} %)."
    ]


def reached(wanted: list[StudyTarget]) -> list[str]:
    """Say how many of the figures to reach are met, and name those that are missed."""
    judged = [one for one in wanted if one.verdict in (MET, MISSED)]
    missed = [
        f"{one.what.removeprefix('of these, ')} ({one.noise})"
        for one in judged
        if one.verdict == MISSED
    ]
    if not judged:
        return []
    names = f" Missed: {'; '.join(missed)}." if missed else ""
    return [f"{len(judged) - len(missed)} of {len(judged)} figures to reach are met.{names}"]
