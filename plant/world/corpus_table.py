"""Read the [corpus] table of a world file: facts known to its generator or importer."""

from math import isfinite
from typing import Final, NamedTuple

from plant.model.errors import Report
from plant.model.geometry import distance_m
from plant.model.types import GoalPose, Start
from plant.world.table import Limits, Table
from runtime.toml_reader import Key

EXAMPLES: Final = {
    "family": '"u_trap"',
    "seed": "1",
    "shortest_path_m": "5.2",
    "reachable": "true",
}
SEED: Final = Limits(0, 2**53)
LENGTH: Final = Limits(0.0, 100_000.0, "m")
MAX_FAMILY_LENGTH: Final = 64
ROUNDED_M: Final = 0.001


class Corpus(NamedTuple):
    """Facts about a world; None if unknown. An unreachable goal has no shortest path."""

    family: str | None = None
    seed: int | None = None
    shortest_path_m: float | None = None
    reachable: bool | None = None


UNKNOWN: Final = Corpus()


def read_corpus(raw: object, at: Key, report: Report) -> Corpus:
    """Return the contents of the table, and report its problems."""
    table = Table(raw, at, EXAMPLES, report)
    family = _family(table) if "family" in table else None
    seed = table.whole_number("seed", SEED) if "seed" in table else None
    length_m = table.number("shortest_path_m", LENGTH) if "shortest_path_m" in table else None
    reachable = table.flag("reachable", default=True) if "reachable" in table else None
    if length_m is not None and reachable is False:
        fix = "remove it, or write reachable = true"
        table.refuse("shortest_path_m", "an unreachable goal has no shortest path", fix)
    return Corpus(family, seed, length_m, True if length_m is not None else reachable)


def check_length(corpus: Corpus, start: Start, goal: GoalPose, report: Report) -> None:
    """Report a shortest path that is shorter than the straight line."""
    length_m = corpus.shortest_path_m
    straight_m = distance_m((start.x_m, start.y_m), (goal.x_m, goal.y_m))
    if length_m is not None and isfinite(length_m) and length_m < straight_m - ROUNDED_M:
        reason = f"{length_m:g} m is shorter than the straight line of {straight_m:.3f} m"
        fix = "remove it; it is then computed when needed"
        report.add(("corpus", "shortest_path_m"), reason, fix)


def _family(table: Table) -> str | None:
    family = table.text("family")
    if isinstance(table.raw["family"], str) and not _is_name(family):
        reason = f"empty, unprintable or longer than {MAX_FAMILY_LENGTH} characters"
        table.refuse("family", reason, f"write family = {EXAMPLES['family']}")
    return family


def _is_name(text: str) -> bool:
    return bool(text.strip()) and text.isprintable() and len(text) <= MAX_FAMILY_LENGTH
