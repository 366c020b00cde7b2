"""The rows of a study as columns, with what every figure of the report is made of.

What counts as a success is decided here and nowhere else: the robot arrived by its own belief and
touched nothing; where there is no way, it said so.
"""

from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from typing import Any, Final

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from protocol.wire.reasons import Reason
from runtime.errors import UserError
from study.runner.rows import COLUMNS, FAILED, SCHEMA
from study.statistics.intervals import CHI2_2, Floats

Flags = NDArray[np.bool_]
Texts = NDArray[np.str_]

NOISES: Final = ("none", "default", "lossy", "harsh")
NAVIGATORS: Final = ("bug", "vgm", "bug1", "bug2", "distbug", "vgm_memory")
UNREACHABLE: Final = "unreachable"
TURNS: Final = ("side", "parameters", "calibrated")
"""What tells apart trials of one navigator where a study varied it."""

SAME_DRIVE: Final = ("world_digest", "navigator", *TURNS, "noise", "digest")
PAIRED: Final = ("world_digest", "noise", "seed", "parameters", "calibrated")


class Trials:
    """Columns of equal length; a null number is NaN, a null text empty."""

    def __init__(self, columns: Mapping[str, Any]) -> None:
        self._columns = columns

    def __len__(self) -> int:
        return len(self._columns["trial_id"])

    def texts(self, name: str) -> Texts:
        found: Texts = self._columns[name]
        return found

    def numbers(self, name: str) -> Floats:
        found: Floats = self._columns[name]
        return found

    def where(self, chosen: Flags) -> "Trials":
        return Trials({name: values[chosen] for name, values in self._columns.items()})

    def has(self, **wanted: str) -> Flags:
        """Whose columns have these values."""
        chosen: Flags = np.ones(len(self), dtype=np.bool_)
        for name, value in wanted.items():
            chosen &= self.texts(name) == value
        return chosen

    def of(self, **wanted: str) -> "Trials":
        """Those whose columns have these values."""
        return self.where(self.has(**wanted))

    def values(self, name: str) -> list[str]:
        """Each that occurs, once, in the report's order."""
        known = {"noise": NOISES, "navigator": NAVIGATORS}.get(name, ())
        found = set(self.texts(name).tolist())
        return [each for each in known if each in found] + sorted(found - set(known))

    def labels(self) -> list[str]:
        """The navigators, told apart by side or parameters where these were varied."""
        navigators = dict(zip(self.texts("label"), self.texts("navigator"), strict=True))
        order = {name: place for place, name in enumerate(NAVIGATORS)}
        return sorted(navigators, key=lambda one: (order.get(navigators[one], len(order)), one))

    @cached_property
    def possible(self) -> Flags:
        """There is a way for the robot, or nobody said there is none."""
        known_shut: Flags = self.numbers("reachable") == 0.0
        return ~(known_shut | self.has(family=UNREACHABLE))

    @cached_property
    def arrived(self) -> Flags:
        untouched: Flags = self.numbers("contacts") == 0.0
        return self.has(outcome="reached") & untouched

    @cached_property
    def gave_up(self) -> Flags:
        """Said that there is no way, and meant it as its last word."""
        found: Flags = self.numbers("goal_reason") == float(Reason.UNREACHABLE)
        return found

    @cached_property
    def recognised(self) -> Flags:
        return self.has(outcome="stuck") & self.gave_up

    @cached_property
    def success(self) -> Flags:
        return np.where(self.possible, self.arrived, self.recognised)

    @cached_property
    def ratio(self) -> Floats:
        """Way driven over the shortest there is, of arrivals."""
        shortest_m = self.numbers("shortest_path_m")
        usable = self.arrived & (shortest_m > 0.0)
        ratio = np.full(len(self), np.nan)
        np.divide(self.numbers("path_m"), shortest_m, out=ratio, where=usable)
        return ratio

    @cached_property
    def inside(self) -> Flags:
        """The true place lies in the robot's own confidence ellipse."""
        found: Flags = self.numbers("mahalanobis2") <= CHI2_2
        return found

    def count(self, chosen: Flags) -> int:
        return int(np.count_nonzero(chosen))


def trials_of(table: pa.Table) -> Trials:
    """Raises UserError for a table without a column of the schema."""
    missing = [name for name in COLUMNS if name not in table.column_names]
    if missing:
        raise UserError(
            f"the table has no column {', '.join(missing)}; it was not written by this version of "
            "`sidestep study`: run the study again"
        )
    columns = {name: _column(table.column(name).cast(SCHEMA.field(name).type)) for name in COLUMNS}
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


def _joined(columns: Mapping[str, Any], names: Sequence[str]) -> Texts:
    rows = zip(*(columns[name].tolist() for name in names), strict=True)
    return np.array(["\t".join(map(str, row)) for row in rows], dtype=np.str_)


def _labels(columns: Mapping[str, Any]) -> Texts:
    """The navigator's name, and whatever of `TURNS` this study varied for it."""
    says: dict[str, Callable[[Any], str]] = {
        "side": str,
        "parameters": str,
        "calibrated": lambda flag: "calibrated" if flag else "not calibrated",
    }
    navigators = columns["navigator"]
    labels: list[str] = navigators.tolist()
    for navigator in set(labels):
        chosen = np.flatnonzero(navigators == navigator)
        for name in TURNS:
            if len(set(columns[name][chosen].tolist())) > 1:
                for index in chosen.tolist():
                    labels[index] += f", {says[name](columns[name][index])}"
    return np.array(labels, dtype=np.str_)


def distinct(trials: Trials) -> Trials:
    """Each drive once: without noise another seed repeats it to the last bit and proves nothing."""
    seen = {
        key: index
        for index, key in reversed(list(enumerate(_joined(trials._columns, SAME_DRIVE).tolist())))
    }
    kept = trials.has(outcome=FAILED)
    kept[list(seen.values())] = True
    return trials.where(kept)
