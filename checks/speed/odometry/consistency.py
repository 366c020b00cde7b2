"""Consistency of the estimated covariance: normalised estimation error squared over many drives.

The error of the pose at the end of a drive, measured in its own covariance, must be distributed as
chi-square. So the mean over the drives lies within known bounds (Bar-Shalom, Li and Kirubarajan,
Estimation with Applications to Tracking and Navigation, 5.4.2).
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from math import sqrt
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from checks.speed.odometry.tree_placement import grow
from plant.model.configuration import noise_of
from plant.sim.simulation import Plant
from protocol.wire.limits import MAX_WHEEL_TTL_MS
from protocol.world import GoalPose, Start, World
from robot.core.parameters import DEFAULTS, Params
from robot.core.perception import odometry as odometries
from robot.core.perception.odometry import Odometry
from robot.core.values import Outputs, Pose, wheels_of, wrap
from robot.parameter_table import with_values
from runtime.config import settings_of
from runtime.units import CONTROL_HZ
from study.calibration import covariance_of
from study.intervals import CHI2_2, Z_TWO_SIDED
from study.trial.core_loop import CoreLoop
from study.trial.trial import Trial, run_trial

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
