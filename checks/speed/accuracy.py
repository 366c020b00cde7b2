"""Accuracy of arrival and of odometry, over many drives between random poses.

Arrival at a pose in an open world is compared with go-then-align. Errors are those of the pose that
the robot estimated when it reported the goal as reached, which excludes odometry errors. A last
turn is a turn on the spot at the goal.

The odometry's covariance is consistent if the error of the pose at the end of a drive, measured in
it (normalised estimation error squared), is distributed as chi-square. So the mean over the drives,
of which 3 is expected for the pose and 2 for the position, lies within known 95 % bounds
(Bar-Shalom, Li and Kirubarajan, Estimation with Applications to Tracking and Navigation, 5.4.2).
Per noise level, a robot calibrated for it drives straight, in curves, stop-and-go and among
obstacles. Noise `none` is compared with its ellipse only: its errors, fractions of encoder ticks,
are bounded.
"""

import argparse
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from math import cos, degrees, dist, hypot, pi, remainder, sin, sqrt
from os import cpu_count
from random import Random
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from checks.harness.figures import BenchmarkFunctions, BenchmarkReport, Figure, figure, percentile
from plant.model.configuration import LEVELS, noise_of
from plant.sim.simulation import Plant
from protocol.navigators import NAVIGATORS, USUAL_NAVIGATOR
from protocol.outcome import CHI2_2
from protocol.wire.limits import MAX_WHEEL_TTL_MS
from protocol.world import GoalPose, Point, Start, World, WorldCircle
from robot.core import states
from robot.core.parameters import DEFAULTS, Params
from robot.core.perception import odometry as odometries
from robot.core.perception.odometry import Odometry
from robot.core.values import Outputs, Pose, wheels_of, wrap
from robot.parameter_table import with_values
from runtime.config import settings_of
from runtime.units import CONTROL_HZ
from study.calibration import covariance_of
from study.intervals import Z_TWO_SIDED
from study.trial.core_loop import CoreLoop
from study.trial.trial import Trial, run_trial

MIN_DISTANCE_M: Final = 0.5
MAX_DISTANCE_M: Final = 5.0
SIDE_M: Final = 14.0
TURN_DEG: Final = 5.0
POSITION_M: Final = 0.03
HEADING_DEG: Final = 2.0
TURNS_PERCENT: Final = 5.0
PEER: Final[Mapping[str, float]] = {"pose_from_m": 0.0}


@dataclass(frozen=True, slots=True, kw_only=True)
class PoseArrival:
    """Errors, time and path of one drive; `ratio` is path length over distance."""

    reached: bool
    position_m: float
    heading_deg: float
    turned_deg: float
    time_s: float
    ratio: float


def add_arrival_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of this benchmark."""
    parser.add_argument("--poses", type=int, default=300)
    parser.add_argument("--noises", nargs="+", choices=LEVELS, default=["none", "default"])
    parser.add_argument("--navigator", choices=NAVIGATORS, default=USUAL_NAVIGATOR)


def measure_arrival(options: argparse.Namespace) -> BenchmarkReport:
    """Measure arrivals with the pose controller and with go-then-align."""
    figures: list[Figure] = []
    for noise in options.noises:
        for label, parameters in (("", {}), ("go-then-align ", PEER)):
            arrivals = [
                arrive(seed, noise, options.navigator, parameters) for seed in range(options.poses)
            ]
            figures += arrival_figures(f"{label}{noise}", arrivals, with_limits=not label)
    notes = (
        f"{options.poses} starts and goals {MIN_DISTANCE_M:g} to {MAX_DISTANCE_M:g} m apart,"
        f" {options.navigator}",
        "position and heading as estimated; default tolerances 0.05 m and 3 deg",
    )
    return BenchmarkReport(benchmark="arrival", figures=tuple(figures), notes=notes)


def between(seed: int) -> World:
    """Return an open world with two random poses far from its walls."""
    random = Random(seed)
    distance_m, towards_rad = (
        random.uniform(MIN_DISTANCE_M, MAX_DISTANCE_M),
        random.uniform(-pi, pi),
    )
    middle_m = SIDE_M / 2.0
    return World(
        name=f"arrival {seed}",
        size_m=(SIDE_M, SIDE_M),
        start=Start(x_m=middle_m, y_m=middle_m, heading_rad=random.uniform(-pi, pi)),
        goal=GoalPose(
            x_m=middle_m + distance_m * cos(towards_rad),
            y_m=middle_m + distance_m * sin(towards_rad),
            heading_rad=random.uniform(-pi, pi),
        ),
    )


class ArrivalRecorder:
    """Record the last estimated pose and the turn on the spot at the goal."""

    def __init__(self) -> None:
        self.turned_rad = 0.0
        self.pose = (0.0, 0.0, 0.0)

    def __call__(self, _plant: Plant, onboard: CoreLoop, _outputs: Outputs) -> None:
        """Record one tick."""
        pose = onboard.state.odometry.pose
        if onboard.state.machine.goal_state == states.ALIGNING:
            self.turned_rad += abs(remainder(pose.heading_rad - self.pose[2], 2.0 * pi))
        self.pose = (pose.x_m, pose.y_m, pose.heading_rad)


def arrive(
    seed: int,
    noise: str,
    navigator: str = USUAL_NAVIGATOR,
    parameters: Mapping[str, float] | None = None,
) -> PoseArrival:
    """Drive from one random pose to the other."""
    world, recorder = between(seed), ArrivalRecorder()
    trial = Trial(
        world=world, navigator=navigator, seed=seed, noise=noise, parameters=parameters or {}
    )
    outcome = run_trial(trial, recorder)
    (x_m, y_m, heading_rad), goal, start = recorder.pose, world.goal, world.start
    assert goal.heading_rad is not None
    return PoseArrival(
        reached=outcome.reached,
        position_m=hypot(x_m - goal.x_m, y_m - goal.y_m),
        heading_deg=degrees(abs(remainder(heading_rad - goal.heading_rad, 2.0 * pi))),
        turned_deg=degrees(recorder.turned_rad),
        time_s=outcome.time_s,
        ratio=outcome.path_m / hypot(goal.x_m - start.x_m, goal.y_m - start.y_m),
    )


def arrival_figures(
    label: str, arrivals: list[PoseArrival], *, with_limits: bool
) -> Iterator[Figure]:
    """Yield the figures; only the robot's own controller is compared with the thresholds."""
    turned = [one.turned_deg for one in arrivals]
    ratios = [one.ratio for one in arrivals]
    worst_m = max(one.position_m for one in arrivals)
    worst_deg = max(one.heading_deg for one in arrivals)
    mean_s = sum(one.time_s for one in arrivals) / len(arrivals)

    def of_label(name: str, value: float, unit: str, at_most: float | None = None) -> Figure:
        limit = at_most if with_limits else None
        return figure(f"{label}: {name}", value, unit, at_most=limit)

    yield of_label("not reached", percent([not one.reached for one in arrivals]), "%", 0.0)
    yield of_label("position, worst", worst_m, "m", POSITION_M)
    yield of_label("heading, worst", worst_deg, "deg", HEADING_DEG)
    turns = percent([turn > TURN_DEG for turn in turned])
    yield of_label(f"last turn over {TURN_DEG:g} deg", turns, "%", TURNS_PERCENT)
    yield of_label("last turn, p90", percentile(turned, 0.9), "deg")
    yield of_label("time, mean", mean_s, "s")
    yield of_label("path / distance, median", percentile(ratios, 0.5), "")
    yield of_label("path / distance, p90", percentile(ratios, 0.9), "")


def percent(found: list[bool]) -> float:
    """Return the share of true values in percent."""
    return 100.0 * sum(found) / len(found)


MIN_THICKNESS_M: Final = 0.05
MAX_THICKNESS_M: Final = 0.15
PASSAGE_M: Final = 0.40
CLEARING_M: Final = 0.50
MAX_THROWS: Final = 100_000


def grow(
    count: int, size_m: Point, clearings: tuple[Point, ...], seed: int
) -> tuple[WorldCircle, ...]:
    """Return `count` trunks in millimetre steps, clear of `clearings`; ValueError if too many."""
    random = np.random.default_rng(seed)
    trunks: list[WorldCircle] = []
    for _ in range(MAX_THROWS):
        radius_m = round(float(random.uniform(MIN_THICKNESS_M, MAX_THICKNESS_M)), 3)
        margin_m = radius_m + PASSAGE_M
        x_m, y_m = (round(float(random.uniform(margin_m, side - margin_m)), 3) for side in size_m)
        trunk = WorldCircle(x_m=x_m, y_m=y_m, radius_m=radius_m)
        if _fits(trunk, trunks, clearings):
            trunks.append(trunk)
        if len(trunks) == count:
            return tuple(trunks)
    raise ValueError(f"{count} trunks do not fit on {size_m[0]:g} x {size_m[1]:g} m")


def _fits(trunk: WorldCircle, trunks: list[WorldCircle], clearings: tuple[Point, ...]) -> bool:
    here = (trunk.x_m, trunk.y_m)
    return all(dist(here, point) >= trunk.radius_m + CLEARING_M for point in clearings) and all(
        dist(here, (other.x_m, other.y_m)) >= trunk.radius_m + other.radius_m + PASSAGE_M
        for other in trunks
    )


KINDS: Final = ("straight", "curves", "stop and go", "obstacles")
FLOOR_M: Final = 40.0

Array = npt.NDArray[np.float64]
Speeds = tuple[float, float]


class Consistency(NamedTuple):
    """Means over the drives (expected: 3 and 2), their confidence bounds, and the share inside."""

    drives: int
    pose: float
    pose_bounds: tuple[float, float]
    position: float
    position_bounds: tuple[float, float]
    inside: float

    @property
    def consistent(self) -> bool:
        """True if both means lie within their bounds."""
        low, high = self.pose_bounds
        least, most = self.position_bounds
        return low <= self.pose <= high and least <= self.position <= most


def consistency_of(errors: Sequence[tuple[Array, Array]]) -> Consistency:
    """Evaluate the error (x, y, heading) and the covariance of each drive."""
    pose = [float(e @ np.linalg.solve(p, e)) for e, p in errors]
    position = [float(e[:2] @ np.linalg.solve(p[:2, :2], e[:2])) for e, p in errors]
    count = len(errors)
    return Consistency(
        drives=count,
        pose=sum(pose) / count,
        pose_bounds=bounds(3, count),
        position=sum(position) / count,
        position_bounds=bounds(2, count),
        inside=sum(distance2 <= CHI2_2 for distance2 in position) / count,
    )


def bounds(degrees_of_freedom: int, count: int) -> tuple[float, float]:
    """Return the confidence bounds of a mean of chi-squares (Wilson and Hilferty)."""
    total = degrees_of_freedom * count
    spread = Z_TWO_SIDED * sqrt(2.0 / (9.0 * total))
    low, high = ((1.0 - 2.0 / (9.0 * total) + sign * spread) ** 3 for sign in (-1.0, 1.0))
    return degrees_of_freedom * low, degrees_of_freedom * high


def drive(kind: str, level: str, seed: int) -> tuple[Array, Array]:
    """Return error and covariance at the end of one drive of a calibrated robot.

    The random numbers of all kinds and seeds differ.
    """
    seed = len(KINDS) * seed + KINDS.index(kind)
    random = np.random.default_rng(seed)
    if kind == "obstacles":
        return among_obstacles(level, seed, random)
    return on_open_floor(list(speeds_of(kind, random)), level, seed, random)


def speeds_of(kind: str, random: np.random.Generator) -> Iterator[Speeds]:
    """Yield left and right wheel speed in m/s per tick; the last ticks are at rest."""
    if kind == "straight":
        speed_m_s = random.uniform(0.15, 0.30)
        yield from [(speed_m_s, speed_m_s)] * int(random.uniform(2.0, 8.0) / speed_m_s * CONTROL_HZ)
    for _ in range(12 if kind == "curves" else 0):
        speed_m_s, turn_m_s = random.uniform(0.05, 0.20), random.uniform(-0.1, 0.1)
        yield from [(speed_m_s - turn_m_s, speed_m_s + turn_m_s)] * int(random.integers(10, 40))
    for _ in range(10 if kind == "stop and go" else 0):
        speed_m_s, turn_m_s = random.uniform(0.05, 0.30), random.uniform(-0.2, 0.2)
        yield from [(speed_m_s, speed_m_s)] * int(random.integers(10, 30))
        yield from [(0.0, 0.0)] * 5
        yield from [(-turn_m_s, turn_m_s)] * int(random.integers(1, 20))
        yield from [(0.0, 0.0)] * 5
    yield from [(0.0, 0.0)] * 10


def on_open_floor(
    speeds: Sequence[Speeds], level: str, seed: int, random: np.random.Generator
) -> tuple[Array, Array]:
    """Drive scripted wheel speeds, so that only the odometry of the core runs."""
    half_m = 0.5 * FLOOR_M
    start = Start(x_m=half_m, y_m=half_m, heading_rad=random.uniform(-3.0, 3.0))
    goal = GoalPose(x_m=half_m + 1.0, y_m=half_m)
    floor = World(name="floor", size_m=(FLOOR_M, FLOOR_M), start=start, goal=goal, walls=False)
    plant, params = Plant(floor, seed, noise_of(floor, level)), params_of(level)
    odometry = Odometry()
    odometry.pose = Pose(start.x_m, start.y_m, start.heading_rad)
    scale = 1000.0 / params.wheel_radius_m
    for left_m_s, right_m_s in (*speeds, (0.0, 0.0)):
        update_odometry(odometry, plant, params)
        plant.command(0, int(left_m_s * scale), int(right_m_s * scale), MAX_WHEEL_TTL_MS)
        plant.advance()
    update_odometry(odometry, plant, params)
    return error_of(plant, odometry), covariance_of(odometry)


def update_odometry(odometry: Odometry, plant: Plant, params: Params) -> None:
    """Update the odometry with the plant's wheel ticks."""
    ticks, _ = plant.senses()
    odometries.update(odometry, None if ticks is None else wheels_of(ticks), params)


def among_obstacles(level: str, seed: int, random: np.random.Generator) -> tuple[Array, Array]:
    """Run a trial in a small forest; the error must fit the covariance for any outcome."""
    size_m = (random.uniform(5.0, 8.0), random.uniform(4.0, 7.0))
    start = Start(x_m=0.6, y_m=random.uniform(1.0, size_m[1] - 1.0))
    goal = GoalPose(x_m=size_m[0] - 0.6, y_m=random.uniform(1.0, size_m[1] - 1.0))
    clearings = ((start.x_m, start.y_m), (goal.x_m, goal.y_m))
    count = int(random.uniform(0.05, 0.35) * size_m[0] * size_m[1])
    trunks = grow(count, size_m, clearings, seed)
    start = replace(start, heading_rad=random.uniform(-3.0, 3.0))
    world = World(name="forest", size_m=size_m, start=start, goal=goal, obstacles=trunks)
    last: list[tuple[Plant, CoreLoop]] = []

    def watch(plant: Plant, onboard: CoreLoop, _: Outputs) -> None:
        last[:] = [(plant, onboard)]

    run_trial(Trial(world=world, seed=seed, noise=level, timeout_s=60.0), watch)
    plant, onboard = last[0]
    odometry = onboard.state.odometry
    return error_of(plant, odometry), covariance_of(odometry)


def params_of(level: str) -> Params:
    """Return the parameters of a robot calibrated for this noise."""
    return with_values(DEFAULTS, settings_of({}, level, calibrated=True))


def error_of(plant: Plant, odometry: Odometry) -> Array:
    """Return true minus estimated pose."""
    truth, pose = plant.truth(), odometry.pose
    turn_rad = wrap(truth.heading_rad - pose.heading_rad)
    return np.array([truth.x_m - pose.x_m, truth.y_m - pose.y_m, turn_rad])


DRIVES = 400
MIN_INSIDE = 0.93


def add_nees_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of this benchmark."""
    parser.add_argument("--drives", type=int, default=DRIVES, help=f"per noise level ({DRIVES})")
    parser.add_argument("--noise", nargs="+", choices=LEVELS, default=list(LEVELS))
    parser.add_argument("--seed", type=int, default=0, help="of the first drive (0)")
    parser.add_argument("--jobs", type=int, default=cpu_count())


def measure_nees(options: argparse.Namespace) -> BenchmarkReport:
    """Measure all noise levels."""
    figures: list[Figure] = []
    notes: list[str] = []
    each = -(-options.drives // len(KINDS))
    with ProcessPoolExecutor(options.jobs) as pool:
        for place, level in enumerate(options.noise):
            first = options.seed + 100_000 * place
            errors: list[tuple[Array, Array]] = []
            for kind in KINDS:
                run = partial(drive, kind, level)
                ended = list(pool.map(run, range(first, first + each), chunksize=8))
                errors += ended
                notes.append(note_of(level, kind, ended))
            figures += nees_figures(level, consistency_of(errors))
    return BenchmarkReport(benchmark="nees", figures=tuple(figures), notes=tuple(notes))


def note_of(level: str, kind: str, ended: Sequence[tuple[Array, Array]]) -> str:
    """Return a note on one kind of drive."""
    found = consistency_of(ended)
    return (
        f"{level}, {kind}: pose {found.pose:.2f}, position {found.position:.2f},"
        f" {100.0 * found.inside:.1f} % inside, {found.drives} drives"
    )


def nees_figures(level: str, found: Consistency) -> Iterator[Figure]:
    """Yield a figure for each of the two bounds, as a figure has one threshold."""
    for name, mean, (low, high) in (
        ("pose, 3 expected", found.pose, found.pose_bounds),
        ("position, 2 expected", found.position, found.position_bounds),
    ):
        whole = f"{level}: NEES of the {name}"
        held = level != "none"
        yield figure(whole, mean, at_least=low if held else None)
        yield figure(whole, mean, at_most=high if held else None)
    name = f"{level}: true position inside its 95 % ellipse"
    yield figure(name, found.inside, at_least=MIN_INSIDE)


ARRIVAL = BenchmarkFunctions(add_arrival_options, measure_arrival)
NEES = BenchmarkFunctions(add_nees_options, measure_nees)
