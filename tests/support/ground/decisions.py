"""Decisions of a robot: made for a test, or of real drives of every navigator."""

from collections.abc import Iterable
from itertools import pairwise
from math import nan, radians
from typing import NamedTuple

from checks.harness.messages import make
from ground.explain.explanation import TurningPoint, turning_point
from plant.sim.simulation import Plant
from plant.world.file import load
from protocol.wire.enums import Branch, GoalState, Mode
from protocol.wire.messages import AvoidanceDecision, CycleReport, NavigatorStatus
from robot import telemetry
from robot.core.values import Outputs
from robot.vehicle import RobotVehicle
from study.trial.core_loop import CoreLoop
from study.trial.trial import Trial, run_trial

TEN_S = 10_000_000_000


def decided(**changes: float) -> AvoidanceDecision:
    """Return a decision to pass an obstacle at the left on its right, with `changes`."""
    seen = {"nearest_bearing_rad": radians(33.75), "nearest_range_m": 0.21, "zone_m": 0.30}
    goal = {"goal_bearing_rad": radians(10.0), "rotation_rad": radians(-66.0)}
    virtual = {"virtual_x_m": 4.25, "virtual_y_m": 1.5, "branch": Branch.PASS_RIGHT}
    motion = {"time_ns": TEN_S, "speed_m_s": 0.12, "yaw_rate_rad_s": radians(-80.0)}
    return make(AvoidanceDecision, **(seen | goal | virtual | motion | changes))


def standing(**changes: float) -> NavigatorStatus:
    """Return a status of a drive to a goal in AUTO with vgm, with `changes`."""
    goal = {"goal_id": 1, "goal_x_m": 5.0, "goal_y_m": 2.0, "goal_heading_rad": nan}
    drive = {"mode": Mode.AUTO, "goal": GoalState.AVOIDING, "goal_distance_m": 3.2}
    return make(NavigatorStatus, **({"time_ns": TEN_S} | goal | drive | changes))


def cycle(**changes: int) -> CycleReport:
    rest = {"time_ns": TEN_S, "tick": 200, "late_us": 400, "sense_age_us": 1500}
    stage_us = (50, 100, 200, 40, 10)
    return make(CycleReport, **({"budget_us": 10_000} | rest | changes), stage_us=stage_us)


def turning_points(decisions: Iterable[AvoidanceDecision]) -> list[TurningPoint]:
    """Return the turning points in the order of the run, without the first decision."""
    found = (turning_point(before, after) for before, after in pairwise(decisions))
    return [point for point in found if point is not None]


WORLDS = ("box", "u_trap", "forest_medium")
TIMEOUT_S = 60.0


class Moment(NamedTuple):
    """One tick; `yaw_rate_rad_s` is what the wheels made of it until the next one."""

    decision: AvoidanceDecision
    status: NavigatorStatus
    yaw_rate_rad_s: float


class Recording:
    """Observes a trial and stores what the robot would have published."""

    def __init__(self) -> None:
        self._told: list[tuple[AvoidanceDecision, NavigatorStatus]] = []
        self._yaw_rates: list[float] = []

    def __call__(self, plant: Plant, onboard: CoreLoop, outputs: Outputs) -> None:
        state, now_ns = onboard.state, plant.now_ns
        zone_m = RobotVehicle.zone_m.fget(onboard)  # type: ignore[attr-defined]
        self._told.append(
            (
                telemetry.decision(outputs, zone_m, now_ns),
                telemetry.status(state, 1, now_ns, onboard.now_ms),
            )
        )
        self._yaw_rates.append(plant.truth().yaw_rate_rad_s)

    def moments(self) -> list[Moment]:
        """Return all ticks but the last, whose successor is unknown."""
        return [
            Moment(*told, yaw) for told, yaw in zip(self._told, self._yaw_rates[1:], strict=False)
        ]


def drive(world: str, navigator: str, noise: str = "none") -> list[Moment]:
    recording = Recording()
    trial = Trial(world=load(world), navigator=navigator, noise=noise, timeout_s=TIMEOUT_S)
    run_trial(trial, recording)
    return recording.moments()
