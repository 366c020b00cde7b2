"""The result of a calibration as a table, as parameters in a file and as JSON."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import hypot
from pathlib import Path
from typing import Any, Final

from robot.core.parameters import Params
from robot.parameters.table import with_values
from robot.storage.files import Store
from study.calibration.fit import Fit
from study.calibration.runs import CCW, CW, SquareRun, errors_of
from study.calibration.umbmark import Umbmark, umbmark

UNITS: Final = {"wheel_ratio": "", "track_m": " m", "k_r_m": " m", "k_l_m": " m"}


@dataclass(frozen=True, slots=True, kw_only=True)
class CalibrationResult:
    """The fit, the runs it was found with (`first`), and runs with it (`second`).

    `second` may be the same runs. `unslipped` is E_max,syst before and after on wheels without
    slip, known in the plant only.
    """

    source: str
    side_m: float
    before: Params
    fit: Fit
    first: Sequence[SquareRun]
    second: Sequence[SquareRun]
    unslipped: tuple[float, float] | None = None

    @property
    def values(self) -> dict[str, float]:
        """The parameters that change."""
        return self.fit.adopted(self.before)

    @property
    def after(self) -> Params:
        """All parameters after the calibration."""
        return with_values(self.before, self.values)

    def marks(self) -> tuple[Umbmark, Umbmark]:
        """Return UMBmark with the old parameters and with the new ones."""
        was = umbmark(self.first, self.before, self.side_m)
        return was, umbmark(self.second, self.after, self.side_m)

    def chance_m(self) -> float:
        """Return the standard error of a centre of gravity of `second`, the noise of E_max,syst."""
        largest = 0.0
        for direction in (CW, CCW):
            errors = errors_of(
                [run for run in self.second if run.direction == direction], self.after
            )
            x_m, y_m = errors[:, :2].std(axis=0, ddof=1) / len(errors) ** 0.5
            largest = max(largest, hypot(x_m, y_m))
        return largest

    def text(self) -> str:
        """Return the result as a table."""
        was, now = self.marks()
        rows = [
            ("", "before", "after"),
            ("centre cw, m", point_text(was.cw_m), point_text(now.cw_m)),
            ("centre ccw, m", point_text(was.ccw_m), point_text(now.ccw_m)),
            ("E_max,syst, m", f"{was.largest_m:.4f}", f"{now.largest_m:.4f}"),
            ("  of that chance", "", f"{self.chance_m():.4f}"),
            ("E_d (wheels)", f"{was.wheel_ratio:.6f}", f"{now.wheel_ratio:.6f}"),
            ("E_b (track)", f"{was.track_ratio:.6f}", f"{now.track_ratio:.6f}"),
        ]
        if self.unslipped is not None:
            before_m, after_m = self.unslipped
            rows.append(("E_max,syst without slip, m", f"{before_m:.4f}", f"{after_m:.4f}"))
        lines = [self.source, *(f"{name:<28}{old:>20}{new:>20}" for name, old, new in rows), ""]
        return "\n".join([*lines, *self.findings()])

    def findings(self) -> list[str]:
        """Return one line per parameter: old value, new value and standard error."""
        lines = []
        for name, value in self.fit.value.items():
            old, unit = getattr(self.before, name), UNITS[name]
            found = f"{value:.6g} +- {self.fit.error[name]:.2g}{unit}"
            decision = "set" if name in self.values else "difference not significant: kept"
            lines.append(f"{name:<12} {old:.6g} -> {found}: {decision}")
        return lines

    def as_json(self) -> dict[str, Any]:
        """Return the result under the keys of the JSON output."""
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


def point_text(point_m: tuple[float, float]) -> str:
    """Format a point in m."""
    return f"{point_m[0]:.4f}, {point_m[1]:.4f}"


def as_toml(result: CalibrationResult, command: str) -> str:
    """Return a file for `sidestep run robot --config`, with command and result as comments."""
    comments = [
        f"# {line}".rstrip() for line in (f"Made by: {command}", *result.text().split("\n"))
    ]
    values = [f"{name} = {value!r}" for name, value in result.values.items()]
    return "\n".join([*comments, "", "[parameters]", *values, ""])


def store(directory: Path, params: Params, values: Mapping[str, float]) -> None:
    """Save values where a robot's `--state` finds them; raise OSError."""
    kept = Store(directory)
    kept.load(params)
    for name, value in values.items():
        ticket = kept.save(name, value)
        if ticket is not None and ticket.error is not None:
            raise ticket.error
