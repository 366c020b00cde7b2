"""The rows of a study as columns, and what every figure of the report is derived from.

Success is defined here only: the robot reached the goal by its own estimate and touched nothing;
where there is no path, it reported so. Groups keep the corpus apart from the families that the
report judges on their own.
"""

from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from typing import Any, Final

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from plant.corpus import ADVERSARIAL_FAMILIES, CROWD_FAMILIES
from plant.model.configuration import LEVELS
from protocol.outcome import CHI2_2, UNREACHABLE
from protocol.wire.reasons import Reason
from runtime.errors import UserError
from study.intervals import Floats, Proportion, independent_size
from study.runner.rows import COLUMNS, FAILED
from study.runner.store import SCHEMA
from study.trial.trial import ALL_NAVIGATORS

Flags = NDArray[np.bool_]
Texts = NDArray[np.str_]

NOISES: Final = tuple(LEVELS)
SHUT: Final = "unreachable"
"""The family of worlds whose goals cannot be reached."""
VARIANTS: Final = ("side", "parameters", "calibrated")
"""Columns that distinguish trials of one navigator where a study varied them."""

SAME_DRIVE: Final = ("world_digest", "navigator", *VARIANTS, "noise", "digest")
PAIRED: Final = ("world_digest", "noise", "seed", "parameters", "calibrated")


class Trials:
    """Columns of equal length; a null number is NaN, a null text is empty."""

    def __init__(self, columns: Mapping[str, Any]) -> None:
        self._columns = columns

    def __len__(self) -> int:
        return len(self._columns["trial_id"])

    def texts(self, name: str) -> Texts:
        """Return a column of texts."""
        found: Texts = self._columns[name]
        return found

    def numbers(self, name: str) -> Floats:
        """Return a column of numbers."""
        found: Floats = self._columns[name]
        return found

    def where(self, chosen: Flags) -> "Trials":
        """Return the chosen rows."""
        return Trials({name: values[chosen] for name, values in self._columns.items()})

    def has(self, **wanted: str) -> Flags:
        """Return which rows have these values."""
        chosen: Flags = np.ones(len(self), dtype=np.bool_)
        for name, value in wanted.items():
            chosen &= self.texts(name) == value
        return chosen

    def of(self, **wanted: str) -> "Trials":
        """Return the rows that have these values."""
        return self.where(self.has(**wanted))

    def paired_with(self, other: "Trials") -> "Trials":
        """Return the rows whose world, noise and seed are those of a row of `other`."""
        return self.where(np.isin(self.texts("pair"), other.texts("pair")))

    def values(self, name: str) -> list[str]:
        """Return each value of a column once, in the report's order."""
        known = {"noise": NOISES, "navigator": tuple(ALL_NAVIGATORS)}.get(name, ())
        found = set(self.texts(name).tolist())
        return [each for each in known if each in found] + sorted(found - set(known))

    def labels(self) -> list[str]:
        """Return the navigators, distinguished by side or parameters where these were varied."""
        navigators = dict(zip(self.texts("label"), self.texts("navigator"), strict=True))
        order = {name: place for place, name in enumerate(ALL_NAVIGATORS)}
        return sorted(navigators, key=lambda one: (order.get(navigators[one], len(order)), one))

    @cached_property
    def possible(self) -> Flags:
        """Rows of worlds with a path to the goal, or not known to have none."""
        known_shut: Flags = self.numbers("reachable") == 0.0
        return ~(known_shut | self.has(family=SHUT))

    @cached_property
    def arrived(self) -> Flags:
        """Rows that reached the goal without a contact."""
        arrived_untouched: Flags = self.numbers("contacts") == 0.0
        return self.has(outcome="reached") & arrived_untouched

    @cached_property
    def gave_up(self) -> Flags:
        """Rows that ended with the report that the goal is unreachable."""
        found: Flags = self.numbers("goal_reason") == float(Reason.UNREACHABLE)
        return found

    @cached_property
    def recognised(self) -> Flags:
        """Rows that ended with that report and without a contact of their own."""
        return self.has(outcome=UNREACHABLE)

    @cached_property
    def success(self) -> Flags:
        """Rows that count as a success."""
        return np.where(self.possible, self.arrived, self.recognised)

    @cached_property
    def ratio(self) -> Floats:
        """Path length over the shortest one, NaN unless the goal was reached."""
        shortest_m = self.numbers("shortest_path_m")
        usable = self.arrived & (shortest_m > 0.0)
        ratio = np.full(len(self), np.nan)
        np.divide(self.numbers("path_m"), shortest_m, out=ratio, where=usable)
        return ratio

    @cached_property
    def laps(self) -> Floats:
        """Time over that of one lap at the robot's top speed, around what shuts the goal off.

        NaN where there is a way, or where the lap is not known.
        """
        lap_m = self.numbers("lap_m")
        laps = np.full(len(self), np.nan)
        way_m = self.numbers("time_s") * self.numbers("top_speed_m_s")
        np.divide(way_m, lap_m, out=laps, where=lap_m > 0.0)
        return laps

    @cached_property
    def inside(self) -> Flags:
        """Rows whose true position lies in the robot's own confidence ellipse."""
        found: Flags = self.numbers("mahalanobis2") <= CHI2_2
        return found

    def count(self, chosen: Flags) -> int:
        """Count the chosen rows."""
        return int(np.count_nonzero(chosen))

    def share(self, chosen: Flags) -> Proportion:
        """Return the share of the chosen rows; its interval allows for several in one world."""
        size = independent_size(chosen, self.texts("world_digest"))
        return Proportion(self.count(chosen), len(self), size)

    @property
    def worlds(self) -> int:
        """The number of different worlds."""
        return len(set(self.texts("world_digest").tolist()))


def trials_of(table: pa.Table) -> Trials:
    """Return the columns of a table; raise UserError if one of the schema is missing."""
    missing = [name for name in COLUMNS if name not in table.column_names]
    if missing:
        raise UserError(
            f"the table has no column {', '.join(missing)}; another version of `sidestep study` "
            "wrote it: run the study again"
        )
    columns = {name: _column(table.column(name).cast(SCHEMA.field(name).type)) for name in COLUMNS}
    columns["outcome"] = _outcomes(columns)
    columns["family"] = np.where(columns["family"] == "", "other", columns["family"])
    columns["label"] = _labels(columns)
    columns["place"] = np.arange(table.num_rows, dtype=np.float64)
    columns["pair"] = _joined(columns, PAIRED)
    return Trials(columns)


def _column(values: Any) -> Any:
    if pa.types.is_string(values.type):
        return np.array([value or "" for value in values.to_pylist()], dtype=np.str_)
    return np.array(
        [np.nan if value is None else float(value) for value in values.to_pylist()],
        dtype=np.float64,
    )


def _outcomes(columns: Mapping[str, Any]) -> Texts:
    """Return the outcomes; earlier versions called a goal without a way `stuck`, too."""
    claimed = columns["goal_reason"] == float(Reason.UNREACHABLE)
    found: Texts = np.where(
        (columns["outcome"] == "stuck") & claimed, UNREACHABLE, columns["outcome"]
    )
    return found


def _joined(columns: Mapping[str, Any], names: Sequence[str]) -> Texts:
    rows = zip(*(columns[name].tolist() for name in names), strict=True)
    return np.array(["\t".join(map(str, row)) for row in rows], dtype=np.str_)


def _labels(columns: Mapping[str, Any]) -> Texts:
    """Return navigators with the values of `VARIANTS` that this study varied for them."""
    formats: dict[str, Callable[[Any], str]] = {
        "side": str,
        "parameters": str,
        "calibrated": lambda flag: "calibrated" if flag else "not calibrated",
    }
    navigators = columns["navigator"]
    labels: list[str] = navigators.tolist()
    for navigator in set(labels):
        chosen = np.flatnonzero(navigators == navigator)
        for name in VARIANTS:
            if len(set(columns[name][chosen].tolist())) > 1:
                for index in chosen.tolist():
                    labels[index] += f", {formats[name](columns[name][index])}"
    return np.array(labels, dtype=np.str_)


def distinct(trials: Trials) -> Trials:
    """Return each drive once: without noise all seeds are bit-identical."""
    seen = {
        key: index
        for index, key in reversed(list(enumerate(_joined(trials._columns, SAME_DRIVE).tolist())))
    }
    kept = trials.has(outcome=FAILED)
    kept[list(seen.values())] = True
    return trials.where(kept)


CORPUS: Final = "corpus"
GRIDS: Final = "grid maps"
ADVERSARIAL: Final = "adversarial worlds"
THIN: Final = "thin walls"
CROWDS: Final = "crowds"

PLANNER: Final = "oracle_grid"
"""The navigator with unlimited memory and the same senses: a comparison, not a competitor."""

GRID_PREFIXES: Final = ("moving_ai", "movingai", "grid")
"""Prefixes of the families in Moving AI's format."""

THIN_PREFIX: Final = "thin"
NOTES: Final = {
    GRIDS: "Maps in the format of Moving AI's benchmark, in cells of a robot's size.",
    ADVERSARIAL: (
        "**Adversarial**: the families of `sidestep falsify`, made to fool a navigator. Their "
        "rates do not describe ordinary places and are in no other figure of this report."
    ),
    THIN: "Walls of 2 to 10 mm, which send few echoes from their ends.",
    CROWDS: "People whose paths cross, so that not every contact can be avoided.",
}
"""What the reader must know about each group that is not the corpus."""


def group_of(family: str) -> str:
    """Return the group of a family; a family without a group of its own is of the corpus."""
    if family in ADVERSARIAL_FAMILIES:
        return ADVERSARIAL
    if family.startswith(GRID_PREFIXES):
        return GRIDS
    if family.startswith(THIN_PREFIX):
        return THIN
    return CROWDS if family in CROWD_FAMILIES else CORPUS


def in_group(trials: Trials, *groups: str) -> Trials:
    """Return the trials in worlds of these groups."""
    return trials.where(_flags(trials, groups))


def main_of(trials: Trials) -> Trials:
    """Return the trials of the corpus; all trials of a study that has none of them."""
    corpus = in_group(trials, CORPUS)
    return corpus if len(corpus) else trials


def apart_of(trials: Trials) -> dict[str, Trials]:
    """Return the trials of each other group that the study has beside the corpus."""
    if not len(in_group(trials, CORPUS)):
        return {}
    found = {group: in_group(trials, group) for group in NOTES}
    return {group: some for group, some in found.items() if len(some)}


def _flags(trials: Trials, groups: tuple[str, ...]) -> Flags:
    families = trials.texts("family").tolist()
    return np.array([group_of(family) in groups for family in families], dtype=np.bool_)
