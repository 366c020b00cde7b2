"""Arrival at a pose between random poses in an open world, compared with go-then-align.

Errors are those of the pose that the robot estimated when it reported the goal as reached, which
excludes odometry errors. A last turn is a turn on the spot at the goal.
"""

import argparse
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from math import cos, degrees, hypot, pi, remainder, sin
from random import Random
from typing import Final

from checks.harness.figures import Figure, Report, percentile
from plant.model.configuration import LEVELS
from plant.sim.simulation import Plant
from protocol.world import GoalPose, Start, World
from robot.core import states
from robot.core.values import Outputs
from study.trial.core_loop import CoreLoop
from study.trial.trial import NAVIGATORS, USUAL_NAVIGATOR, Trial, run_trial

MIN_DISTANCE_M: Final = 0.5
MAX_DISTANCE_M: Final = 5.0
SIDE_M: Final = 14.0
TURN_DEG: Final = 5.0
POSITION_M: Final = 0.03
HEADING_DEG: Final = 2.0
TURNS_PERCENT: Final = 5.0
PEER: Final[Mapping[str, float]] = {"pose_from_m": 0.0}


@dataclass(frozen=True, slots=True, kw_only=True)
class Arrival:
    """Errors, time and path of one drive; `ratio` is path length over distance."""

    reached: bool
    position_m: float
    heading_deg: float
    turned_deg: float
    time_s: float
    ratio: float


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of this benchmark."""
    parser.add_argument("--poses", type=int, default=300)
    parser.add_argument("--noises", nargs="+", choices=LEVELS, default=["none", "default"])
    parser.add_argument("--navigator", choices=NAVIGATORS, default=USUAL_NAVIGATOR)


def measure(options: argparse.Namespace) -> Report:
    """Measure arrivals with the pose controller and with go-then-align."""
    figures: list[Figure] = []
    for noise in options.noises:
        for label, parameters in (("", {}), ("go-then-align ", PEER)):
            arrivals = [
                arrive(seed, noise, options.navigator, parameters) for seed in range(options.poses)
            ]
            figures += figures_of(f"{label}{noise}", arrivals, with_limits=not label)
    notes = (
        f"{options.poses} starts and goals {MIN_DISTANCE_M:g} to {MAX_DISTANCE_M:g} m apart,"
        f" {options.navigator}",
        "position and heading as estimated; default tolerances 0.05 m and 3 deg",
    )
    return Report(benchmark="arrival", figures=tuple(figures), notes=notes)


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
) -> Arrival:
    """Drive from one random pose to the other."""
    world, recorder = between(seed), ArrivalRecorder()
    trial = Trial(
        world=world, navigator=navigator, seed=seed, noise=noise, parameters=parameters or {}
    )
    outcome = run_trial(trial, recorder)
    (x_m, y_m, heading_rad), goal, start = recorder.pose, world.goal, world.start
    assert goal.heading_rad is not None
    return Arrival(
        reached=outcome.reached,
        position_m=hypot(x_m - goal.x_m, y_m - goal.y_m),
        heading_deg=degrees(abs(remainder(heading_rad - goal.heading_rad, 2.0 * pi))),
        turned_deg=degrees(recorder.turned_rad),
        time_s=outcome.time_s,
        ratio=outcome.path_m / hypot(goal.x_m - start.x_m, goal.y_m - start.y_m),
    )


def figures_of(label: str, arrivals: list[Arrival], *, with_limits: bool) -> Iterator[Figure]:
    """Yield the figures; only the robot's own controller is compared with the thresholds."""
    turned = [one.turned_deg for one in arrivals]
    ratios = [one.ratio for one in arrivals]
    worst_m = max(one.position_m for one in arrivals)
    worst_deg = max(one.heading_deg for one in arrivals)
    mean_s = sum(one.time_s for one in arrivals) / len(arrivals)

    def figure(name: str, unit: str, value: float, most: float | None = None) -> Figure:
        at_most = most if with_limits else None
        return Figure(name=f"{label}: {name}", unit=unit, values=(value,), at_most=at_most)

    yield figure("not reached", "%", percent([not one.reached for one in arrivals]), 0.0)
    yield figure("position, worst", "m", worst_m, POSITION_M)
    yield figure("heading, worst", "deg", worst_deg, HEADING_DEG)
    turns = percent([turn > TURN_DEG for turn in turned])
    yield figure(f"last turn over {TURN_DEG:g} deg", "%", turns, TURNS_PERCENT)
    yield figure("last turn, p90", "deg", percentile(turned, 0.9))
    yield figure("time, mean", "s", mean_s)
    yield figure("path / distance, median", "", percentile(ratios, 0.5))
    yield figure("path / distance, p90", "", percentile(ratios, 0.9))


def percent(found: list[bool]) -> float:
    """Return the share of true values in percent."""
    return 100.0 * sum(found) / len(found)
