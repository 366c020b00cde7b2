"""Calibrate wheels, track and slip from UMBmark squares, driven by a robot or in the plant.

The log of a drive is a CSV file with one line per control period (50 ms):
`run,direction,left,right,x_m,y_m,heading_deg`. `run` is the number of the run, `direction` cw or
ccw, `left` and `right` are the encoder counters. Only the last line of a run carries the pose
measured at its end. That pose is relative to the robot's start: x forward, y to the left, heading
counter-clockwise.

UMBmark (Borenstein and Feng, 1996) derives wheel errors from the return errors. The robot starts
heading along x and drives the square with left turns (ccw, y > 0) or with right turns (cw, y < 0).
Unequal wheels bend the sides, a wrong track falsifies the corners. When driven in both directions,
one error shows in the difference of the two centres of gravity, the other in their sum. Let a side
be bent by b and a corner turned d too far, both to the left and small. Then ccw returns by
2 L (d + b) in x and as much in -y, cw by 2 L (d - b) in x and in y.

The fit has standard errors. Wheels and track are found by generalized least squares: each end is
weighted with the covariance of the robot's own odometry. Then k_r and k_l follow by maximum
likelihood from the remaining scatter.
"""

import csv
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from io import StringIO
from itertools import groupby
from math import cos, degrees, exp, hypot, isfinite, log, pi, radians, sin
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from plant.model.configuration import Noise
from plant.sim.simulation import Plant
from protocol.outcome import wire_goal
from protocol.wire.limits import MAX_WHEEL_TTL_MS
from protocol.world import GoalPose, Start, World
from robot.core import reasons, states
from robot.core.modes import goal_is_active
from robot.core.parameters import Params
from robot.core.perception import odometry as odometries
from robot.core.perception.odometry import Odometry
from robot.core.values import Outputs, Pose, Wheels, wrap
from robot.hosting import ORIGIN, InProcessCore
from robot.parameter_table import with_values
from runtime.errors import ConfigError, not_a_number
from runtime.files import drafted, text_in
from runtime.units import PERIOD_MS
from study.trial.core_loop import CoreLoop

CW: Final = "cw"
CCW: Final = "ccw"
DIRECTIONS: Final = (CW, CCW)

Array = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class SquareRun:
    """The encoder counters (left, right) of one square, from the start, at each control period.

    `measured` is the pose at the end relative to the start: x forward, y left, heading.
    """

    direction: str
    ticks: Sequence[tuple[int, int]]
    measured: Pose


def believed(run: SquareRun, params: Params) -> Odometry:
    """Return the core's odometry after the ticks of a run with these parameters."""
    odometry = Odometry()
    for k, (left, right) in enumerate(run.ticks):
        odometries.update(odometry, Wheels(left, right, 0, k * PERIOD_MS), params)
    return odometry


def error_of(run: SquareRun, odometry: Odometry) -> Array:
    """Return measured minus estimated x, y, heading (the paper's return position errors)."""
    measured, pose = run.measured, odometry.pose
    turn_rad = wrap(measured.heading_rad - pose.heading_rad)
    return np.array([measured.x_m - pose.x_m, measured.y_m - pose.y_m, turn_rad])


def errors_of(runs: Iterable[SquareRun], params: Params) -> Array:
    """Return the errors of the runs, shape (runs, 3)."""
    return np.array([error_of(run, believed(run, params)) for run in runs]).reshape(-1, 3)


def covariance_of(odometry: Odometry) -> Array:
    """Return the 3x3 covariance of an odometry."""
    o = odometry
    return np.array([[o.pxx, o.pxy, o.pxh], [o.pxy, o.pyy, o.pyh], [o.pxh, o.pyh, o.phh]])


COLUMNS: Final = ("run", "direction", "left", "right", "x_m", "y_m", "heading_deg")
MEASURED: Final = COLUMNS[4:]
MAX_BYTES: Final = 1 << 26
MIN_TICKS: Final = 2
MIN_RUNS: Final = 2


class CalibrationLogLine(NamedTuple):
    """One line of the file."""

    number: int
    run: str
    direction: str
    ticks: tuple[int, int]
    measured: Pose | None


def write_log(path: Path, runs: Iterable[SquareRun]) -> None:
    """Write a log; raise OSError."""
    with drafted(path) as draft, draft.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(COLUMNS)
        for number, run in enumerate(runs, 1):
            x_m, y_m, heading_rad = run.measured
            for left, right in run.ticks[:-1]:
                writer.writerow((number, run.direction, left, right, "", "", ""))
            end = (f"{x_m:.7f}", f"{y_m:.7f}", f"{degrees(heading_rad):.6f}")
            writer.writerow((number, run.direction, *run.ticks[-1], *end))


def read_log(path: Path) -> list[SquareRun]:
    """Read a log; raise ConfigError that names file, line, fault and remedy.

    Cells may be between semicolons, with decimal commas, as some spreadsheets write them.
    """
    try:
        text, separator = text_in(path, MAX_BYTES), ","
        if ";" in text.partition("\n")[0]:
            text, separator = text.replace(",", "."), ";"
        rows = csv.reader(StringIO(text, newline=""), delimiter=separator)
        lines = list(_lines(path, rows))
    except OSError as error:
        raise _refusal(path, "", str(error.strerror).lower(), "check the path") from error
    except (UnicodeDecodeError, csv.Error) as error:
        raise _refusal(path, "", "is not CSV text in UTF-8", "save it so") from error
    runs = [_run(path, list(group)) for _, group in groupby(lines, lambda line: line.run)]
    for direction in DIRECTIONS:
        count = sum(run.direction == direction for run in runs)
        if count < MIN_RUNS:
            fix = f"drive at least {MIN_RUNS}, better 20, in each direction"
            raise _refusal(path, "", f"has {count} runs {direction}", fix)
    return runs


def _lines(path: Path, rows: Iterator[list[str]]) -> Iterator[CalibrationLogLine]:
    head = next(rows, [])
    if tuple(name.strip() for name in head) != COLUMNS:
        fix = f"begin with {','.join(COLUMNS)}"
        raise _refusal(path, "line 1", f"has the columns {','.join(head) or 'none'}", fix)
    for number, row in enumerate(rows, 2):
        where = f"line {number}"
        if len(row) != len(COLUMNS):
            raise _refusal(path, where, f"has {len(row)} fields", f"write {len(COLUMNS)}")
        run, direction, left, right, *end = (field.strip() for field in row)
        if direction not in DIRECTIONS:
            fix = f"write {' or '.join(DIRECTIONS)}"
            raise _refusal(path, f"{where}: direction", f"{direction!r} is not a direction", fix)
        ticks = (_whole(path, where, "left", left), _whole(path, where, "right", right))
        yield CalibrationLogLine(number, run, direction, ticks, _measured(path, where, end))


def _run(path: Path, lines: Sequence[CalibrationLogLine]) -> SquareRun:
    last = lines[-1]
    where = f"line {last.number}"
    if last.measured is None:
        fix = f"give {', '.join(MEASURED)} on the last line of each run"
        raise _refusal(path, where, f"ends run {last.run} without a measured pose", fix)
    for line in lines[:-1]:
        if line.measured is not None:
            fix = "give it on the last line only, and give each run its own number"
            raise _refusal(path, f"line {line.number}", "has a pose in the middle of a run", fix)
    if len(lines) < MIN_TICKS or lines[0].ticks == last.ticks:
        raise _refusal(path, where, f"ends run {last.run}, which did not move", "leave it out")
    if any(line.direction != last.direction for line in lines):
        fix = "give each run its own number"
        raise _refusal(path, where, f"run {last.run} has both directions", fix)
    return SquareRun(
        direction=last.direction,
        ticks=[line.ticks for line in lines],
        measured=last.measured,
    )


def _measured(path: Path, where: str, fields: Sequence[str]) -> Pose | None:
    if not any(fields):
        return None
    values = []
    for name, text in zip(MEASURED, fields, strict=True):
        try:
            value = float(text)
        except ValueError:
            value = float("nan")
        if not isfinite(value):
            raise _refusal(path, f"{where}: {name}", not_a_number(text), "measure it")
        values.append(value)
    return Pose(values[0], values[1], wrap(radians(values[2])))


def _whole(path: Path, where: str, name: str, text: str) -> int:
    try:
        return int(text)
    except ValueError:
        fix = "write the encoder counter"
        raise _refusal(path, f"{where}: {name}", f"{text!r} is not a whole number", fix) from None


def _refusal(path: Path, key: str, reason: str, fix: str) -> ConfigError:
    return ConfigError(file=str(path), key=key, reason=reason, fix=fix)


FLOOR_M: Final = 400.0
TOLERANCE_M: Final = 0.02
TOLERANCE_RAD: Final = radians(0.5)
MAX_TICKS: Final = 20_000
CORNERS: Final = ((1.0, 0.0), (1.0, 1.0), (0.0, 1.0), (0.0, 0.0))


class SquareError(RuntimeError):
    """The robot did not complete the square."""


def drive(noise: Noise, params: Params, count: int, seed: int, side_m: float) -> list[SquareRun]:
    """Drive `count` squares in each direction; seeds of the directions differ."""
    halves = ((CW, 2 * seed), (CCW, 2 * seed + 1))
    return [run for way, own in halves for run in squares(way, noise, params, count, own, side_m)]


def squares(
    direction: str, noise: Noise, params: Params, count: int, seed: int, side_m: float
) -> Iterator[SquareRun]:
    """Yield squares driven one after the other on the same floor.

    The plant is not recreated between them: putting a robot back does not reset its encoders. False
    echoes are left out, because the robot would avoid them and leave the square.
    """
    half_m = 0.5 * FLOOR_M
    start = Start(x_m=half_m, y_m=half_m)
    goal = GoalPose(x_m=half_m + 1.0, y_m=half_m)
    size_m = (FLOOR_M, FLOOR_M)
    floor = World(name="floor", size_m=size_m, start=start, goal=goal, walls=False)
    plant = Plant(floor, seed, replace(noise, ghost_probability=0.0))
    # Drive straight to each corner and turn on the spot, instead of curving into the heading.
    params = params._replace(pose_from_m=0.0)
    for _ in range(count):
        yield square(direction, plant, params, side_m)


def square(direction: str, plant: Plant, params: Params, side_m: float) -> SquareRun:
    """Drive one square from the present pose, with an odometry that starts at zero."""
    turn = 1.0 if direction == CCW else -1.0
    begun = plant.truth()
    driver = SquareDriver(plant, CoreLoop(InProcessCore(params, ORIGIN, totals_of(plant))))
    for k, (x, y) in enumerate(CORNERS):
        driver.go(side_m * x, turn * side_m * y, wrap(turn * radians(90.0) * (k + 1)))
    ended = plant.truth()
    dx_m, dy_m = ended.x_m - begun.x_m, ended.y_m - begun.y_m
    cosine, sine = cos(begun.heading_rad), sin(begun.heading_rad)
    heading_rad = wrap(ended.heading_rad - begun.heading_rad)
    measured = Pose(cosine * dx_m + sine * dy_m, cosine * dy_m - sine * dx_m, heading_rad)
    return SquareRun(direction=direction, ticks=driver.ticks, measured=measured)


def totals_of(plant: Plant) -> tuple[int, int]:
    """Return the present encoder counters, which are those at the start of the next square."""
    wheels, _ = plant.senses()
    if wheels is None:
        raise SquareError("the plant sent no wheel ticks")
    return wheels.left, wheels.right


class SquareDriver:
    """Run core and plant tick by tick; `ticks` are the encoder counters."""

    def __init__(self, plant: Plant, onboard: CoreLoop) -> None:
        self._plant, self._onboard = plant, onboard
        self.ticks: list[tuple[int, int]] = []
        self._outputs = self._step()

    def go(self, x_m: float, y_m: float, heading_rad: float) -> None:
        """Drive to a pose; raise SquareError when it is refused or not reached."""
        machine = self._onboard.state.machine
        refusal = self._onboard.go(wire_goal(x_m, y_m, heading_rad, TOLERANCE_M, TOLERANCE_RAD))
        if refusal != reasons.OK:
            raise SquareError(f"a corner of the square was refused: reason {refusal}")
        for _ in range(MAX_TICKS):
            outputs = self._outputs
            self._plant.command(0, outputs.left_mrad_s, outputs.right_mrad_s, MAX_WHEEL_TTL_MS)
            if not goal_is_active(machine):
                break
            self._plant.advance()
            self._outputs = self._step()
        if machine.goal_state != states.REACHED:
            raise SquareError(f"a corner was not reached: goal state {machine.goal_state}")

    def _step(self) -> Outputs:
        wheels, scan = self._plant.senses()
        if wheels is not None:
            self.ticks.append((wheels.left, wheels.right))
        return self._onboard.step(self._plant.now_ns, wheels, scan)


@dataclass(frozen=True, slots=True, kw_only=True)
class Umbmark:
    """Centres of gravity of the return errors in metres, and the paper's ratios.

    `wheel_ratio` (E_d) and `track_ratio` (E_b) are true over assumed values; 1 is a correct robot.
    """

    cw_m: tuple[float, float]
    ccw_m: tuple[float, float]
    wheel_ratio: float
    track_ratio: float

    @property
    def largest_m(self) -> float:
        """E_max,syst: the larger distance of both centres of gravity."""
        return max(hypot(*self.cw_m), hypot(*self.ccw_m))


def umbmark(runs: Sequence[SquareRun], params: Params, side_m: float) -> Umbmark:
    """Evaluate squares with these parameters; runs of both directions are required."""
    cw = centre([run for run in runs if run.direction == CW], params)
    ccw = centre([run for run in runs if run.direction == CCW], params)
    left_rad, right_rad = (ccw[0] - ccw[1]) / (4.0 * side_m), (cw[0] + cw[1]) / (4.0 * side_m)
    bent_rad, corner_rad = 0.5 * (left_rad - right_rad), 0.5 * (left_rad + right_rad)
    return Umbmark(
        cw_m=(float(cw[0]), float(cw[1])),
        ccw_m=(float(ccw[0]), float(ccw[1])),
        wheel_ratio=wheel_ratio(bent_rad, side_m, params.track_m),
        track_ratio=0.5 * pi / (0.5 * pi + corner_rad),
    )


def wheel_ratio(bent_rad: float, side_m: float, track_m: float) -> float:
    """Return E_d from the bend of a side to the left, by the radii of both wheels' arcs."""
    if abs(bent_rad) < 1e-9:
        return 1.0
    radius_m = 0.5 * side_m / sin(0.5 * bent_rad)
    return (radius_m + 0.5 * track_m) / (radius_m - 0.5 * track_m)


def centre(runs: Sequence[SquareRun], params: Params) -> Array:
    """Return the mean error of the runs."""
    mean: Array = errors_of(runs, params).mean(axis=0)
    return mean


SYSTEMATIC: Final = ("wheel_ratio", "track_m")
ROUNDS: Final = 4
STEP: Final = 1e-4
PROBE_M: Final = 1e-9
MIN_STANDARD_ERRORS: Final = 2.58
"""Standard errors by which a parameter must differ to be changed; by chance one in a hundred."""
MIN_K_M: Final = 1e-10
MAX_K_M: Final = 1e-2
SHRINK: Final = 0.6180339887498949
SEARCH_ROUNDS: Final = 36
"""The search ends within 3e-8 of the span, which is logarithmic."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Fit:
    """Best value and standard error by parameter name."""

    value: dict[str, float]
    error: dict[str, float]

    def adopted(self, before: Params) -> dict[str, float]:
        """Return only values that differ from the present ones by more than chance.

        The standard error of a k grows with the true k, which may be the present one.
        """
        kept = {}
        for name, value in self.value.items():
            now, error = float(getattr(before, name)), self.error[name]
            if name not in SYSTEMATIC and value > 0.0:
                error *= max(1.0, now / value)
            if abs(value - now) > MIN_STANDARD_ERRORS * error:
                kept[name] = float(f"{value:.6g}")
        return kept


class CovarianceParts(NamedTuple):
    """Per run: covariance by whole ticks and per unit k of both wheels, and the bend per unit k."""

    grain: Array
    by_slip: Array
    bend: Array

    def covariance(self, k_m: float) -> Array:
        """Return the covariances of all runs for this k, shape (runs, 3, 3)."""
        bend = k_m * self.bend
        total: Array = self.grain + k_m * self.by_slip + bend[:, :, None] * bend[:, None, :]
        return total


def fit_parameters(runs: Sequence[SquareRun], before: Params) -> Fit:
    """Alternate between wheels and track with the present k, and k from the residuals.

    Raises OutOfRangeError or LinAlgError for runs that no robot can have driven.
    """
    params, k_m = before, max(0.5 * (before.k_r_m + before.k_l_m), MIN_K_M)
    information: Array = np.zeros((2, 2))
    for _ in range(ROUNDS):
        spreads = covariance_parts_of(runs, params)
        weights = np.linalg.inv(spreads.covariance(k_m))
        slopes, errors = jacobians_of(runs, params), errors_of(runs, params)
        information = np.einsum("nip,nij,njq->pq", slopes, weights, slopes)
        pull = np.einsum("nip,nij,nj->p", slopes, weights, errors)
        change = np.linalg.solve(information, pull)
        values = [getattr(params, name) for name in SYSTEMATIC] + change
        params = with_values(params, dict(zip(SYSTEMATIC, map(float, values), strict=True)))
        k_m = most_likely_k(errors - np.einsum("nip,p->ni", slopes, change), spreads)
    return with_standard_errors(params, information, k_m, len(runs))


def with_standard_errors(params: Params, information: Array, k_m: float, runs: int) -> Fit:
    """Return the fit with the standard error of each parameter.

    That of a variance follows from the number of errors it was estimated from.
    """
    covariance = np.linalg.inv(information)
    relative = (2.0 / (3 * runs - len(SYSTEMATIC))) ** 0.5
    value = {name: float(getattr(params, name)) for name in SYSTEMATIC}
    error = dict(zip(SYSTEMATIC, map(float, np.sqrt(np.diag(covariance))), strict=True))
    for name in ("k_r_m", "k_l_m"):
        value[name] = k_m if k_m > 1.01 * MIN_K_M else 0.0
        error[name] = relative * k_m
    return Fit(value=value, error=error)


def covariance_parts_of(runs: Sequence[SquareRun], params: Params) -> CovarianceParts:
    """Run the core's odometry without slip, and with a small slip as a probe."""
    still = with_values(params, {"k_r_m": 0.0, "k_l_m": 0.0})
    probe = with_values(params, {"k_r_m": PROBE_M, "k_l_m": PROBE_M})
    grain, by_slip, bends = [], [], []
    for run in runs:
        grain.append(covariance_of(believed(run, still)))
        probed = believed(run, probe)
        by_slip.append((covariance_of(probed) - grain[-1]) / PROBE_M)
        bends.append(np.array([probed.bend_x_m, probed.bend_y_m, 0.0]) / PROBE_M)
    return CovarianceParts(np.array(grain), np.array(by_slip), np.array(bends))


def jacobians_of(runs: Sequence[SquareRun], params: Params) -> Array:
    """Return derivatives of the estimated ends, shape (runs, 3, parameters)."""
    slopes = []
    for name in SYSTEMATIC:
        step = STEP * getattr(params, name)
        more = with_values(params, {name: getattr(params, name) + step})
        less = with_values(params, {name: getattr(params, name) - step})
        slopes.append((errors_of(runs, less) - errors_of(runs, more)) / (2.0 * step))
    stacked: Array = np.stack(slopes, axis=2)
    return stacked


def most_likely_k(errors: Array, spreads: CovarianceParts) -> float:
    """Return one k for both wheels: on a square both roll as far, so they cannot be separated."""

    def minus_log_likelihood(k_m: float) -> float:
        covariance = spreads.covariance(k_m)
        distance2 = np.einsum("ni,nij,nj->", errors, np.linalg.inv(covariance), errors)
        return float(distance2 + np.linalg.slogdet(covariance)[1].sum())

    return minimum(minus_log_likelihood, MIN_K_M, MAX_K_M)


def minimum(function: Callable[[float], float], low: float, high: float) -> float:
    """Return the minimum of a unimodal function by golden-section search on the logarithm."""
    a, b = log(low), log(high)
    c, d = b - SHRINK * (b - a), a + SHRINK * (b - a)
    at_c, at_d = function(exp(c)), function(exp(d))
    for _ in range(SEARCH_ROUNDS):
        if at_c < at_d:
            b, d, at_d = d, c, at_c
            c = b - SHRINK * (b - a)
            at_c = function(exp(c))
        else:
            a, c, at_c = c, d, at_d
            d = a + SHRINK * (b - a)
            at_d = function(exp(d))
    return exp(0.5 * (a + b))
