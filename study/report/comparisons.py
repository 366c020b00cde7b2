"""Pairwise comparison of navigators on the same worlds, seeds and noise, with tests."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Final

import numpy as np

from study.report.page import PageCell, PageTable
from study.report.trials import Trials
from study.report.words import count, interval, number, probability
from study.statistics.intervals import (
    Interval,
    binomial_two_sided,
    holm,
    mcnemar,
    quantile,
    quantile_interval,
    signed_rank,
)

LEVEL: Final = 0.05


@dataclass(frozen=True, slots=True, kw_only=True)
class Comparison:
    """Two navigators at one noise level.

    `worlds_*` counts worlds in which one succeeded more often. The `p_*` are adjusted by Holm's
    method in `comparisons`.
    """

    noise: str
    first: str
    second: str
    pairs: int
    only_first: int
    only_second: int
    p_success: float
    worlds_first: int
    worlds_second: int
    p_worlds: float
    common: int
    ratio: float
    """Median over common successes of the first path length over the second."""
    ratio_interval: Interval
    p_ratio: float


def comparisons(trials: Trials, noise: str) -> list[Comparison]:
    """Compare each pair of navigators at one noise level.

    All tests of one kind at one noise level form one family for Holm's method.
    """
    chosen = trials.of(noise=noise)
    each = {label: runs_by_pair(chosen.of(label=label)) for label in chosen.labels()}
    found = [
        comparison(noise, (first, each[first]), (second, each[second]))
        for first, second in combinations(each, 2)
    ]
    found = [one for one in found if one.pairs]
    adjusted = zip(
        found,
        holm([one.p_success for one in found]),
        holm([one.p_worlds for one in found]),
        holm([one.p_ratio for one in found]),
        strict=True,
    )
    return [
        replace(one, p_success=success, p_worlds=worlds, p_ratio=ratio)
        for one, success, worlds, ratio in adjusted
    ]


@dataclass(frozen=True, slots=True)
class ComparedRun:
    """The values of one trial that a comparison needs."""

    world: str
    success: bool
    path_m: float
    """NaN unless the goal was reached."""


def runs_by_pair(trials: Trials) -> Mapping[str, ComparedRun]:
    """Return the runs of a navigator by the key they share with their counterparts."""
    path_m = np.where(trials.arrived & trials.possible, trials.numbers("path_m"), np.nan).tolist()
    rows = zip(
        trials.texts("pair").tolist(),
        trials.texts("world_digest").tolist(),
        trials.success.tolist(),
        path_m,
        strict=True,
    )
    return {pair: ComparedRun(world, success, way_m) for pair, world, success, way_m in rows}


def comparison(
    noise: str,
    one: tuple[str, Mapping[str, ComparedRun]],
    other: tuple[str, Mapping[str, ComparedRun]],
) -> Comparison:
    """Compare two navigators without adjusting the p-values."""
    pairs = [(ran, other[1][key]) for key, ran in sorted(one[1].items()) if key in other[1]]
    only_first = sum(a.success and not b.success for a, b in pairs)
    only_second = sum(b.success and not a.success for a, b in pairs)
    worlds_first, worlds_second = _worlds(pairs)
    common = [(a.path_m, b.path_m) for a, b in pairs if a.path_m > 0.0 and b.path_m > 0.0]
    logs = np.log(np.array(common, dtype=np.float64).reshape(-1, 2))
    ratios = [a / b for a, b in common]
    return Comparison(
        noise=noise,
        first=one[0],
        second=other[0],
        pairs=len(pairs),
        only_first=only_first,
        only_second=only_second,
        p_success=mcnemar(only_first, only_second),
        worlds_first=worlds_first,
        worlds_second=worlds_second,
        p_worlds=binomial_two_sided(worlds_first, worlds_first + worlds_second),
        common=len(common),
        ratio=quantile(ratios, 0.5),
        ratio_interval=quantile_interval(ratios, 0.5),
        p_ratio=signed_rank(logs[:, 0] - logs[:, 1]),
    )


def _worlds(pairs: list[tuple[ComparedRun, ComparedRun]]) -> tuple[int, int]:
    """Return in how many worlds the first succeeded more often, and the second."""
    lead: dict[str, int] = {}
    for a, b in pairs:
        lead[a.world] = lead.get(a.world, 0) + a.success - b.success
    return sum(value > 0 for value in lead.values()), sum(value < 0 for value in lead.values())


def comparison_table(found: list[Comparison], noise: str) -> PageTable:
    """Return the table of the comparisons at one noise level."""
    head = (
        *("first", "second", "pairs", "only first", "only second", "p"),
        *("worlds first : second", "p by worlds"),
        *("both arrive", "path first / second, median", "p path"),
    )
    rows = tuple(
        (
            *(one.first, one.second, count(one.pairs)),
            *(count(one.only_first), count(one.only_second)),
            _p(one.p_success, one.only_first - one.only_second),
            f"{one.worlds_first} : {one.worlds_second}",
            _p(one.p_worlds, one.worlds_first - one.worlds_second),
            count(one.common),
            f"{number(one.ratio, 3)} {interval(one.ratio_interval, 3)}",
            _p(one.p_ratio, 1.0 - one.ratio),
        )
        for one in found
    )
    caption = (
        f"Noise `{noise}`. Success: exact McNemar test on trials, and a sign test on worlds, which "
        "does not treat several seeds of one world as independent. Path: Wilcoxon's signed ranks "
        "of the logarithms where both arrive. All p-values are adjusted by Holm's method; "
        f"**bold**, with the better one, where p < {LEVEL:g}."
    )
    return PageTable(caption, head, rows, names=2)


def _p(p: float, lead: float) -> PageCell:
    """Return a p-value, marked and with the better one where it is significant."""
    if p >= LEVEL or not lead:
        return PageCell(probability(p))
    return PageCell(f"**{probability(p)}** {'first' if lead > 0 else 'second'}")
