"""What a calibration found, as a table, as parameters in a file and as JSON."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import hypot
from pathlib import Path
from typing import Any, Final

from robot.core.parameters import Params
from robot.parameters.table import with_values
from robot.storage.files import Store
from study.calibration.fit import Fit
from study.calibration.runs import CCW, CW, Run, errors_of
from study.calibration.umbmark import Umbmark, umbmark

UNITS: Final = {"wheel_ratio": "", "track_m": " m", "k_r_m": " m", "k_l_m": " m"}


@dataclass(frozen=True, slots=True, kw_only=True)
class Result:
    """`first`: the runs it was found with; `second`: runs after it, or the first judged anew.

    `unslipped` is E_max,syst before and after on wheels that do not slip, which only the plant has.
    """

    source: str
    side_m: float
    before: Params
    fit: Fit
    first: Sequence[Run]
    second: Sequence[Run]
    unslipped: tuple[float, float] | None = None

    @property
    def values(self) -> dict[str, float]:
        return self.fit.adopted(self.before)

    @property
    def after(self) -> Params:
        return with_values(self.before, self.values)

    def marks(self) -> tuple[Umbmark, Umbmark]:
        """UMBmark by the old parameters, and by the new ones."""
        was = umbmark(self.first, self.before, self.side_m)
        return was, umbmark(self.second, self.after, self.side_m)

    def chance_m(self) -> float:
        """Standard error of a centre of gravity of `second`: what of E_max,syst may be chance."""
        largest = 0.0
        for direction in (CW, CCW):
            errors = errors_of(
                [run for run in self.second if run.direction == direction], self.after
            )
            x_m, y_m = errors[:, :2].std(axis=0, ddof=1) / len(errors) ** 0.5
            largest = max(largest, hypot(x_m, y_m))
        return largest

    def text(self) -> str:
        was, now = self.marks()
        rows = [
            ("", "before", "after"),
            ("centre cw, m", place(was.cw_m), place(now.cw_m)),
            ("centre ccw, m", place(was.ccw_m), place(now.ccw_m)),
            ("E_max,syst, m", f"{was.largest_m:.4f}", f"{now.largest_m:.4f}"),
            ("  of it chance", "", f"{self.chance_m():.4f}"),
            ("E_d (wheels)", f"{was.wheel_ratio:.6f}", f"{now.wheel_ratio:.6f}"),
            ("E_b (track)", f"{was.track_ratio:.6f}", f"{now.track_ratio:.6f}"),
        ]
        if self.unslipped is not None:
            before_m, after_m = self.unslipped
            rows.append(("E_max,syst without slip, m", f"{before_m:.4f}", f"{after_m:.4f}"))
        lines = [self.source, *(f"{name:<28}{old:>20}{new:>20}" for name, old, new in rows), ""]
        return "\n".join([*lines, *self.findings()])

    def findings(self) -> list[str]:
        """One line per parameter: what it was, is, and how surely."""
        lines = []
        for name, value in self.fit.value.items():
            old, unit = getattr(self.before, name), UNITS[name]
            found = f"{value:.6g} +- {self.fit.error[name]:.2g}{unit}"
            told = "set" if name in self.values else "no different for sure: kept"
            lines.append(f"{name:<12} {old:.6g} -> {found}: {told}")
        return lines

    def as_json(self) -> dict[str, Any]:
        was, now = self.marks()
        return {
            "source": self.source,
            "parameters": self.values,
            "found": self.fit.value,
            "standard_error": self.fit.error,
            "largest_before_m": was.largest_m,
            "largest_after_m": now.largest_m,
            "chance_m": self.chance_m(),
            "wheel_ratio_umbmark": was.wheel_ratio,
            "track_ratio_umbmark": was.track_ratio,
            "unslipped_before_m": None if self.unslipped is None else self.unslipped[0],
            "unslipped_after_m": None if self.unslipped is None else self.unslipped[1],
        }


def place(point_m: tuple[float, float]) -> str:
    return f"{point_m[0]:.4f}, {point_m[1]:.4f}"


def as_toml(result: Result, command: str) -> str:
    """A file for `sidestep robot --config`; its comment says how it was made and what it did."""
    comments = [
        f"# {line}".rstrip() for line in (f"Made by: {command}", *result.text().split("\n"))
    ]
    values = [f"{name} = {value!r}" for name, value in result.values.items()]
    return "\n".join([*comments, "", "[parameters]", *values, ""])


def store(directory: Path, params: Params, values: Mapping[str, float]) -> None:
    """Beside what an operator has saved there, where a robot's `--state` finds it. OSError."""
    kept = Store(directory)
    kept.load(params)
    for name, value in values.items():
        ticket = kept.save(name, value)
        if ticket is not None and ticket.error is not None:
            raise ticket.error
