"""Success of each navigator by family of worlds."""

from study.report.page import PageCell, PageCellLike, PageTable
from study.report.trials import Trials
from study.report.words import DASH, count, percent
from study.statistics.intervals import Share


def family_table(trials: Trials, noise: str) -> PageTable:
    """Return success by family at one noise level, coloured from warm (0) to cool (1)."""
    chosen = trials.of(noise=noise)
    labels = chosen.labels()
    rows = []
    for family in chosen.values("family"):
        some = chosen.of(family=family)
        worlds = len(set(some.texts("world_digest").tolist()))
        rows.append((family, count(worlds), *(_cell(some.of(label=label)) for label in labels)))
    caption = (
        f"Noise `{noise}`: success in percent by family; in `unreachable`, success is to report "
        "it. In brackets: successes / trials."
    )
    return PageTable(caption, ("family", "worlds", *labels), tuple(rows))


def _cell(trials: Trials) -> PageCellLike:
    if not len(trials):
        return PageCell(DASH, "none")
    found = Share(trials.count(trials.success), len(trials))
    return PageCell(f"{percent(found.rate, 0)} ({found.count}/{found.of})", heat=found.rate)
