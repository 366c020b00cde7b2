"""Compare navigators in pairs, with tests, and the project's own with two bounds.

A pair has the same world, seed and noise. The omniscient bound is the shortest path in a known map.
The planner's is the way of `oracle_grid`, which has the same sensors, unlimited memory and time, on
the same world, noise and seed. It is no strict bound: without a map of the world the planner may
choose the longer side, too.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import combinations
from math import nan
from typing import Final, NamedTuple

import numpy as np

from study.intervals import (
    Floats,
    Interval,
    binomial_two_sided,
    by_world,
    holm,
    quantile,
    quantile_interval,
    signed_rank,
)
from study.report.page import (
    DASH,
    Block,
    PageCell,
    PageSection,
    PageTable,
    Paragraph,
    count_text,
    interval,
    number,
    percent,
    probability,
)
from study.report.targets import MET, MISSED, NEAR, OWN, RATIO, UNMEASURED
from study.report.trials import PLANNER, Flags, Trials

LEVEL: Final = 0.05


@dataclass(frozen=True, slots=True, kw_only=True)
class PairedComparison:
    """Two navigators at one noise level.

    Both are judged by worlds: several seeds of one are no independent trials. `worlds_*` counts
    worlds in which one succeeded more often. The `p_*` are adjusted by Holm's method in
    `comparisons`.
    """

    noise: str
    first: str
    second: str
    pairs: int
    only_first: int
    only_second: int
    worlds: int
    worlds_first: int
    worlds_second: int
    p_worlds: float
    common: int
    ratio: float
    """Median over common successes of the first path length over the second."""
    ratio_interval: Interval
    p_ratio: float


def comparisons(trials: Trials, noise: str) -> list[PairedComparison]:
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
        holm([one.p_worlds for one in found]),
        holm([one.p_ratio for one in found]),
        strict=True,
    )
    return [replace(one, p_worlds=worlds, p_ratio=ratio) for one, worlds, ratio in adjusted]


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
) -> PairedComparison:
    """Compare two navigators without adjusting the p-values."""
    pairs = [(ran, other[1][key]) for key, ran in sorted(one[1].items()) if key in other[1]]
    only_first = sum(a.success and not b.success for a, b in pairs)
    only_second = sum(b.success and not a.success for a, b in pairs)
    worlds_first, worlds_second = _worlds(pairs)
    common = [(a, b) for a, b in pairs if a.path_m > 0.0 and b.path_m > 0.0]
    ratios = np.array([a.path_m / b.path_m for a, b in common], dtype=np.float64)
    places = np.array([a.world for a, _ in common], dtype=np.str_)
    return PairedComparison(
        noise=noise,
        first=one[0],
        second=other[0],
        pairs=len(pairs),
        only_first=only_first,
        only_second=only_second,
        worlds=len({a.world for a, _ in pairs}),
        worlds_first=worlds_first,
        worlds_second=worlds_second,
        p_worlds=binomial_two_sided(worlds_first, worlds_first + worlds_second),
        common=len(common),
        ratio=quantile(ratios, 0.5),
        ratio_interval=quantile_interval(ratios, 0.5, places),
        p_ratio=signed_rank(by_world(np.log(ratios), places)),
    )


def _worlds(pairs: list[tuple[ComparedRun, ComparedRun]]) -> tuple[int, int]:
    """Return in how many worlds the first succeeded more often, and the second."""
    lead: dict[str, int] = {}
    for a, b in pairs:
        lead[a.world] = lead.get(a.world, 0) + a.success - b.success
    return sum(value > 0 for value in lead.values()), sum(value < 0 for value in lead.values())


def comparison_table(found: list[PairedComparison], noise: str) -> PageTable:
    """Return the table of the comparisons at one noise level."""
    head = (
        *("first", "second", "pairs", "only first", "only second"),
        *("worlds", "better first : second", "p by worlds"),
        *("both arrive", "path first / second, median", "p path by worlds"),
    )
    rows = tuple(
        (
            *(one.first, one.second, count_text(one.pairs)),
            *(count_text(one.only_first), count_text(one.only_second)),
            count_text(one.worlds),
            f"{one.worlds_first} : {one.worlds_second}",
            _p(one.p_worlds, one.worlds_first - one.worlds_second),
            count_text(one.common),
            f"{number(one.ratio, 3)} {interval(one.ratio_interval, 3)}",
            _p(one.p_ratio, 1.0 - one.ratio),
        )
        for one in found
    )
    caption = (
        f"Noise `{noise}`. Success: a sign test on the worlds in which one succeeds more often. "
        "Path: Wilcoxon's signed ranks of the worlds' mean logarithms where both arrive. No test "
        "counts several seeds of one world as independent. All p-values are adjusted by Holm's "
        f"method; **bold**, with the better one, where p < {LEVEL:g}."
    )
    return PageTable(caption, head, rows, names=2)


def _p(p: float, lead: float) -> PageCell:
    """Return a p-value, marked and with the better one where it is significant."""
    if p >= LEVEL or not lead:
        return PageCell(probability(p))
    return PageCell(f"**{probability(p)}** {'first' if lead > 0 else 'second'}")


MEDIAN, NINETIETH = 0.5, 0.9
TICKS: Final = ("ticks_to_goal", "ticks_passing_left", "ticks_passing_right", "ticks_aligning")


class RowBounds(NamedTuple):
    """Both bounds of a trial; NaN where unknown.

    `shortest_m` is the omniscient one, NaN without a path. `planner_m` is the planner's way if it
    reached the goal untouched, and `planner_s` its time if it reported the goal as unreachable.
    """

    shortest_m: float
    planner_m: float
    planner_s: float


def bounds_of(trials: Trials) -> list[RowBounds]:
    """Return both bounds of each trial, in the order of the rows."""
    planner = trials.of(navigator=PLANNER)
    ways, times = by_pair(planner, planner.arrived, "path_m"), _recognition_s(planner)
    rows = zip(
        trials.numbers("shortest_path_m").tolist(), trials.texts("pair").tolist(), strict=True
    )
    return [
        RowBounds(shortest_m, ways.get(pair, nan), times.get(pair, nan))
        for shortest_m, pair in rows
    ]


def by_pair(trials: Trials, chosen: Flags, column: str) -> dict[str, float]:
    """Return the values of the chosen rows by the key that they share with their counterparts."""
    some = trials.where(chosen)
    return dict(zip(some.texts("pair").tolist(), some.numbers(column).tolist(), strict=True))


def _recognition_s(trials: Trials) -> dict[str, float]:
    return by_pair(trials, trials.recognised & ~trials.possible, "time_s")


@dataclass(frozen=True, slots=True)
class Ways:
    """Ways over the shortest ones, of trials in which both navigators reached the goal."""

    own: Floats
    planner: Floats

    def at(self, share: float) -> tuple[float, float]:
        """Return a quantile of the own ratios and of the planner's."""
        return quantile(self.own, share), quantile(self.planner, share)

    @property
    def excess(self) -> Floats:
        """The own way over the planner's, trial by trial."""
        return self.own / self.planner


def ways_of(trials: Trials) -> Ways:
    """Return the ways of the trials in which both navigators reached the goal untouched."""
    own = trials.of(navigator=OWN)
    bounds = bounds_of(trials)
    kept = np.flatnonzero(trials.has(navigator=OWN)).tolist()
    planner = np.array([bounds[row].planner_m for row in kept]) / own.numbers("shortest_path_m")
    both = np.isfinite(own.ratio) & np.isfinite(planner)
    return Ways(own.ratio[both], planner[both])


def bounds_section(trials: Trials) -> PageSection | None:
    """Return the section; None if the planner or the own navigator is not in the study."""
    navigators = trials.values("navigator")
    if OWN not in navigators or PLANNER not in navigators:
        return None
    blocks: list[Block] = [Paragraph(READING)]
    for noise in trials.values("noise"):
        some = trials.of(noise=noise)
        if all(len(some.of(navigator=name)) for name in (OWN, PLANNER)):
            blocks += [figure_table(some, noise), way_table(some, noise)]
            blocks += recognition_tables(some, noise)
    return PageSection("Against two bounds", tuple(blocks))


READING: Final = (
    f"`{PLANNER}` is a navigator for studies only. It has the sensors of the others, a map of "
    "unlimited size, and searches the shortest route through what it has not seen to be occupied. "
    f"What `{OWN}` loses against it is due to its memory and its rules; what `{PLANNER}` loses "
    "against the shortest path is due to what the sensors have not seen yet. Compared are trials "
    "in the same world with the same noise and seed in which both reach the goal. These are fewer "
    "trials than those behind the figures to reach, so the same quantile differs there. "
    f"`{PLANNER}` is no strict bound: it chooses by what it has seen so far, and may choose the "
    f"longer side. Where own / planner is below 1, `{OWN}` drove the shorter way."
)


def figure_table(trials: Trials, noise: str) -> PageTable:
    """Return the figures to reach: the way over the shortest one, or near the planner's."""
    ways = ways_of(trials)
    rows = []
    for share, name, most in RATIO:
        own, planner = ways.at(share)
        verdict = UNMEASURED
        if len(ways.own):
            verdict = MET if own <= max(most, NEAR * planner) else MISSED
        wanted = f"at most {most:.2f}, or {NEAR:g} x that of {PLANNER}"
        measured = (number(own), interval(quantile_interval(ways.own, share)), number(planner))
        rows.append((name, wanted, *measured, PageCell(verdict, TONES.get(verdict, "open"))))
    caption = (
        f"Noise `{noise}`: way of `{OWN}` over the shortest path, in the"
        f" {count_text(len(ways.own))} trials in which `{PLANNER}` arrived, too. The figures to"
        " reach are over all arrivals."
    )
    head = ("way over shortest", "wanted", OWN, "interval", PLANNER, "verdict")
    return PageTable(caption, head, tuple(rows), names=2)


TONES: Final = {MET: "good", MISSED: "bad"}


def way_table(trials: Trials, noise: str) -> PageTable:
    """Return where the way goes, family by family."""
    reachable = trials.where(trials.possible)
    rows = tuple(_way_row(name, some) for name, some in _families(reachable))
    caption = (
        f"Noise `{noise}`: way over the shortest path, median and 90th percentile, of pairs in "
        f"which both arrive; own way over that of `{PLANNER}`, median with interval and worst; "
        f"shares of the time that `{OWN}` and `{PLANNER}` head for the goal, the rest passes "
        "obstacles or turns; changes of side, mean."
    )
    head = ("family", "pairs", OWN, PLANNER, "own / planner", "worst", "to goal", "changes")
    return PageTable(caption, head, rows)


def _way_row(family: str, trials: Trials) -> tuple[str, ...]:
    ways = ways_of(trials)
    (own, planner), (own_90, planner_90) = ways.at(MEDIAN), ways.at(NINETIETH)
    excess = ways.excess
    return (
        family,
        count_text(len(ways.own)),
        f"{number(own)} / {number(own_90)}",
        f"{number(planner)} / {number(planner_90)}",
        _with(quantile(excess, MEDIAN), quantile_interval(excess, MEDIAN)),
        number(quantile(excess, 1.0)),
        _both(trials, lambda one: percent(_to_goal(one), 0)),
        _both(trials, lambda one: number(_mean(one.numbers("side_changes")), 1)),
    )


def recognition_tables(trials: Trials, noise: str) -> Iterator[PageTable]:
    """Yield the time to recognise an unreachable goal, family by family, if there is such a one."""
    some = trials.where(~trials.possible)
    if not len(some):
        return
    rows = tuple(_recognition_row(name, part) for name, part in _families(some))
    caption = (
        f"Noise `{noise}`: unreachable goals that were recognised, and the time until then in s, "
        "median and 90th percentile; own time over that of the planner where both did, median."
    )
    head = ("family", "trials", f"recognised, {OWN}", f"recognised, {PLANNER}", OWN, PLANNER)
    yield PageTable(caption, (*head, "own / planner"), rows)


def _recognition_row(family: str, trials: Trials) -> tuple[str, ...]:
    own, planner = (_recognition_s(trials.of(navigator=name)) for name in (OWN, PLANNER))
    both = [own[pair] / planner[pair] for pair in own if pair in planner]
    times = [list(found.values()) for found in (own, planner)]
    return (
        family,
        count_text(len(trials.of(navigator=OWN))),
        *(count_text(len(found)) for found in times),
        *(
            f"{number(quantile(found, MEDIAN), 0)} / {number(quantile(found, NINETIETH), 0)}"
            for found in times
        ),
        _with(quantile(both, MEDIAN), quantile_interval(both, MEDIAN)),
    )


def _families(trials: Trials) -> Iterator[tuple[str, Trials]]:
    """Yield each family with its trials, then all together."""
    families = trials.values("family")
    for family in families:
        yield family, trials.of(family=family)
    if len(families) > 1:
        yield "all", trials


def _to_goal(trials: Trials) -> float:
    ticks = [float(trials.numbers(name).sum()) for name in TICKS]
    total = ticks[0] + ticks[1] + ticks[2] + ticks[3]
    return ticks[0] / total if total else nan


def _mean(values: Floats) -> float:
    return float(values.mean()) if len(values) else nan


def _both(trials: Trials, text: Callable[[Trials], str]) -> str:
    return " / ".join(text(trials.of(navigator=name)) for name in (OWN, PLANNER))


def _with(value: float, span: Interval) -> str:
    text = interval(span)
    return number(value) if text == DASH else f"{number(value)} {text}"
