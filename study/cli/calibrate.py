"""`sidestep calibrate`: find wheels, track and slip of a robot from squares driven both ways.

The result is a table, JSON, parameters in a file, and a plot of the return errors.
"""

import argparse
import json
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from importlib.util import find_spec
from math import hypot
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from numpy.linalg import LinAlgError

from ground.recording.figure import INK, RULE, SOFT, TRUE, WARM
from plant.model.configuration import LEVELS
from protocol.options import add_param_option, whole
from robot.core.parameters import DEFAULTS, Params
from robot.parameter_table import OutOfRangeError, adjusted, with_values
from robot.storage import Store
from runtime.cli.parsers import new_parser
from runtime.errors import UserError
from runtime.files import drafted
from study import calibration
from study.calibration import (
    CCW,
    CW,
    Fit,
    SquareRun,
    Umbmark,
    drive,
    errors_of,
    fit_parameters,
    umbmark,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes


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


LOOKS: Final = {CW: ("o", TRUE, "clockwise"), CCW: ("s", WARM, "counter-clockwise")}
"""Marker, colour and name of each direction."""


def write(path: Path, result: CalibrationResult) -> None:
    """Write an SVG or PNG file; raise OSError, or ValueError for another suffix."""
    from matplotlib.figure import Figure  # slow import, needed only here

    figure = Figure(figsize=(9.0, 5.2), layout="constrained")
    panels = figure.subplots(1, 2)
    runs = ((result.first, result.before), (result.second, result.after))
    most_m = max(float(abs(errors_of(some, params)[:, :2]).max()) for some, params in runs)
    for axes, name, (some, params), mark in zip(
        panels, ("before", "after"), runs, result.marks(), strict=True
    ):
        draw(axes, some, params, mark)
        axes.set_title(f"{name}: E_max,syst {1000.0 * mark.largest_m:.1f} mm", color=INK)
        axes.set(xlim=(-1.1 * most_m, 1.1 * most_m), ylim=(-1.1 * most_m, 1.1 * most_m))
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=4, frameon=False)
    figure.suptitle(f"Return errors: {result.source}", color=INK)
    with drafted(path) as draft:
        figure.savefig(draft, metadata={"Date": None} if path.suffix == ".svg" else None)


def draw(axes: "Axes", runs: Sequence[SquareRun], params: Params, mark: Umbmark) -> None:
    """Draw each run, an arrow to the centre of each direction, and the circle of E_max,syst."""
    from matplotlib.patches import Circle

    for direction, centre_m in ((CW, mark.cw_m), (CCW, mark.ccw_m)):
        shape, colour, name = LOOKS[direction]
        errors = errors_of([run for run in runs if run.direction == direction], params)
        axes.scatter(errors[:, 0], errors[:, 1], s=14, marker=shape, color=colour, label=name)
        if hypot(*centre_m) > 0.0:
            arrow = {"arrowstyle": "-|>", "color": colour, "shrinkA": 0.0, "shrinkB": 0.0}
            axes.annotate("", centre_m, (0.0, 0.0), arrowprops=arrow)
    limit = Circle((0.0, 0.0), mark.largest_m, fill=False, ec=INK, ls="--", label="E_max,syst")
    axes.add_patch(limit)
    axes.axhline(0.0, color=SOFT, linewidth=0.6)
    axes.axvline(0.0, color=SOFT, linewidth=0.6)
    axes.grid(color=RULE, linewidth=0.5)
    axes.set_axisbelow(True)
    axes.set(xlabel="return error x (m)", ylabel="return error y (m)")
    axes.set_aspect("equal", adjustable="box")


RUNS = 20
MAX_RUNS = 1000
MIN_SIDE_M, MAX_SIDE_M = 0.5, 50.0
"""Limits of the side of a square."""
SIDE_M = 4.0
PLOTS = (".svg", ".png")
DETAILS = (
    "Drives UMBmark squares in the plant, or reads a log of them, and finds wheel_ratio, track_m,"
    " k_r_m and k_l_m.\nA value is set only when it differs significantly.\n"
)


def main(argv: Sequence[str]) -> int:
    """Return 0, or 2 for wrong usage (argparse); raise ConfigError or UserError for a bad log."""
    options = parser().parse_args(list(argv))
    check_options(options)
    params = adjusted(DEFAULTS, dict(options.param), "--param")
    result = from_log(options, params) if options.log else from_plant(options, params)
    try:
        save(options, result, shlex.join(["sidestep", "calibrate", *argv]))
    except OSError as error:
        raise UserError(f"{error.filename}: cannot be written: {error.strerror}") from error
    print(json.dumps(result.as_json()) if options.json else result.text())
    return 0


def from_plant(options: argparse.Namespace, params: Params) -> CalibrationResult:
    """Drive squares, fit the parameters, and drive again with the fitted ones."""
    noise, side_m = LEVELS[options.noise], options.side
    first = drive(noise, params, options.runs, 2 * options.seed, side_m)
    fit = fit_parameters(first, params)
    after = with_values(params, fit.adopted(params))
    even = replace(noise, slip_variance_m=0.0)
    before_m, after_m = (
        umbmark(drive(even, which, 1, 0, side_m), which, side_m).largest_m
        for which in (params, after)
    )
    return CalibrationResult(
        source=f"{options.runs} squares of {side_m:g} m in each direction in the plant,"
        f" noise {options.noise}, seed {options.seed}",
        side_m=side_m,
        before=params,
        fit=fit,
        first=first,
        second=drive(noise, after, options.runs, 2 * options.seed + 1, side_m),
        unslipped=(before_m, after_m),
    )


def from_log(options: argparse.Namespace, params: Params) -> CalibrationResult:
    """Fit the runs of a real robot; the result evaluates the same runs before and after.

    Raises UserError for runs that no robot can have driven.
    """
    runs: list[SquareRun] = calibration.read_log(Path(options.log))
    try:
        fit = fit_parameters(runs, params)
        with_values(params, fit.adopted(params))
    except (OutOfRangeError, LinAlgError) as error:
        raise UserError(
            f"{options.log}: these runs fit no robot ({error}); check the measured poses, whether"
            " left and right are swapped, and m_per_tick (--param)"
        ) from error
    return CalibrationResult(
        source=f"{len(runs)} squares of {options.side:g} m from {options.log}; after: the same",
        side_m=options.side,
        before=params,
        fit=fit,
        first=runs,
        second=runs,
    )


def save(options: argparse.Namespace, result: CalibrationResult, command: str) -> None:
    """Write the files that the options name; raise OSError."""
    if options.save_log:
        calibration.write_log(Path(options.save_log), result.first)
    if options.output:
        with drafted(Path(options.output)) as draft:
            draft.write_text(as_toml(result, command), encoding="utf-8")
    if options.state:
        store(Path(options.state), DEFAULTS, result.values)
    if options.plot:
        write(Path(options.plot), result)


def check_options(options: argparse.Namespace) -> None:
    """Raise UserError for options that argparse cannot check, before the drives begin."""
    if options.log and options.save_log:
        raise UserError("--save-log saves driven runs, not those of --log; leave one of them out")
    if options.plot and Path(options.plot).suffix not in PLOTS:
        raise UserError(f"--plot {options.plot}: name a file that ends in {' or '.join(PLOTS)}")
    if options.plot and find_spec("matplotlib") is None:
        raise UserError("--plot needs matplotlib: pip install 'sidestep[study]'")


def parser() -> argparse.ArgumentParser:
    """Return the parser of the verb."""
    made = new_parser(
        "calibrate", details=f"{DETAILS}\n{calibration.__doc__}".rstrip(), allow_abbrev=True
    )
    made.add_argument(
        "--noise", choices=LEVELS, default="default", help="of the plant (default default)"
    )
    made.add_argument("--seed", type=whole(0), default=0, help="of the random numbers (default 0)")
    made.add_argument(
        "--runs",
        type=whole(2, MAX_RUNS),
        default=RUNS,
        metavar="N",
        help=f"squares in each direction (default {RUNS})",
    )
    made.add_argument(
        "--side",
        type=length,
        default=SIDE_M,
        metavar="M",
        help=f"of the square (default {SIDE_M:g})",
    )
    add_param_option(made, "the robot's present parameters, as often as needed")
    made.add_argument("--log", metavar="FILE", help="use the runs in this file (see below)")
    made.add_argument("--save-log", metavar="FILE", help="write the runs to such a file")
    made.add_argument("--output", metavar="FILE", help="TOML for `sidestep run robot --config`")
    made.add_argument("--state", metavar="DIR", help="save for `sidestep run robot --state DIR`")
    made.add_argument("--plot", metavar="FILE", help="return errors before and after, .svg or .png")
    made.add_argument("--json", action="store_true", help="print one JSON object")
    return made


def length(text: str) -> float:
    """Parse the side of a square in m; raise ArgumentTypeError outside the limits."""
    try:
        value = float(text)
    except ValueError:
        value = float("nan")
    if not MIN_SIDE_M <= value <= MAX_SIDE_M:
        limits = f"{MIN_SIDE_M:g} to {MAX_SIDE_M:g} m"
        raise argparse.ArgumentTypeError(f"{text!r} is not a length of {limits}")
    return value
