"""Navigator by family of worlds: where each succeeds and where it does not."""

from study.report.page import Cell, CellLike, Table
from study.report.trials import Trials
from study.report.words import DASH, count, percent
from study.statistics.intervals import Share


def family_table(trials: Trials, noise: str) -> Table:
    """Success by family at one noise, coloured from warm (never) to cool (always)."""
    chosen = trials.of(noise=noise)
    labels = chosen.labels()
    rows = []
    for family in chosen.values("family"):
        some = chosen.of(family=family)
        worlds = len(set(some.texts("world_digest").tolist()))
        rows.append((family, count(worlds), *(_cell(some.of(label=label)) for label in labels)))
    caption = (
        f"Noise `{noise}`: success in percent by family; in `unreachable`, saying so is the "
        "success. The counts are of successes and trials."
    )
    return Table(caption, ("family", "worlds", *labels), tuple(rows))


def _cell(trials: Trials) -> CellLike:
    if not len(trials):
        return Cell(DASH, "none")
    found = Share(trials.count(trials.success), len(trials))
    return Cell(f"{percent(found.rate, 0)} ({found.count}/{found.of})", heat=found.rate)
