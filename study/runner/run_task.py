"""Run one task of a study and return its row, however the trial ends."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from datetime import UTC, datetime
from math import nan
from time import perf_counter, thread_time
from types import MappingProxyType
from typing import Any, Final

from plant.model.types import Polyline, World
from protocol.outcome import Outcome
from robot.core import states
from study.runner.lap import lap_m
from study.runner.plan import TrialTask
from study.runner.provenance import CodeVersion, machine
from study.runner.rows import COLUMNS, FAILED, TrialRow
from study.runner.scores import published_score, spl
from study.trial.behaviour import Behaviour
from study.trial.trial import Trial, params_of, run_trial

TASK_COLUMNS: Final = tuple(field.name for field in fields(TrialTask) if field.name in COLUMNS)
MEASURED: Final = (
    *("time_s", "path_m", "min_clearance_m"),
    *("position_error_m", "estimated_position_error_m"),
)
COUNTED: Final = ("contacts", "own_contacts", "ticks")
NO_OUTCOME: Final[Mapping[str, Any]] = MappingProxyType(
    {
        **dict.fromkeys(MEASURED, nan),
        **dict.fromkeys(COUNTED, 0),
        "heading_error_rad": None,
        "digest": "",
    }
)
"""Values of a trial without an outcome."""


NO_SCORES: Final[Mapping[str, Any]] = MappingProxyType(
    {**dict.fromkeys(("top_speed_m_s", "spl", "published_score"), nan), "lap_m": None}
)
"""Scores of a trial without an outcome."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StudyContext:
    """The data that all trials of a study share; sent once to every worker."""

    study: str
    code: CodeVersion
    worlds: Sequence[World]


def trial_of(source: TrialTask | TrialRow, world: World) -> Trial:
    """Return the trial of a task, or that of a row to repeat it."""
    return Trial(
        world=world,
        navigator=source.navigator,
        side=source.side,
        seed=source.seed,
        noise=source.noise,
        timeout_s=source.timeout_s,
        parameters=json.loads(source.parameters),
        calibrated=source.calibrated,
    )


def row_of(task: TrialTask, context: StudyContext) -> TrialRow:
    """Run a task; an exception becomes a failed row and does not end the study."""
    watch, started_utc = Behaviour(), _now_utc()
    wall_s, cpu_s = perf_counter(), thread_time()
    try:
        trial = trial_of(task, context.worlds[task.place])
        outcome = run_trial(trial, watch)
        wall_s, cpu_s = perf_counter() - wall_s, thread_time() - cpu_s
        scores = _scores(outcome, trial)
    except Exception as error:
        return failed(task, context, f"{type(error).__name__}: {error}", started_utc)
    return TrialRow(
        **_request_values(task, context),
        **_outcome_values(outcome),
        **scores,
        **_final_values(outcome, watch),
        **_behaviour_values(watch),
        wall_s=wall_s,
        cpu_s=cpu_s,
        started_utc=started_utc,
    )


def failed(
    task: TrialTask, context: StudyContext, reason: str, started_utc: str | None = None
) -> TrialRow:
    """Return the row of a trial that could not be run to its end."""
    empty = Behaviour()
    return TrialRow(
        **_request_values(task, context),
        **NO_OUTCOME,
        **NO_SCORES,
        **_final_values(None, empty),
        **_behaviour_values(empty),
        outcome=FAILED,
        reason=reason,
        wall_s=nan,
        cpu_s=nan,
        started_utc=started_utc or _now_utc(),
    )


def _request_values(task: TrialTask, context: StudyContext) -> dict[str, Any]:
    """Return identity, world and provenance of a row."""
    world, code = context.worlds[task.place], context.code
    return {
        **{name: getattr(task, name) for name in TASK_COLUMNS},
        "study": context.study,
        "world": world.name,
        "family": world.family,
        "shortest_path_m": world.shortest_path_m,
        "reachable": world.reachable,
        "thinnest_wall_m": thinnest_wall_m(world),
        "commit": code.commit,
        "dirty": code.dirty,
        "version": code.version,
        **machine()._asdict(),
    }


def thinnest_wall_m(world: World) -> float | None:
    """Return the thickness of the thinnest wall in metres; None without a wall on the floor."""
    walls = (one for one in world.obstacles if isinstance(one, Polyline))
    return min((wall.thickness_m for wall in walls), default=None)


def _outcome_values(outcome: Outcome) -> dict[str, Any]:
    """Return the values of the outcome under the names of a row."""
    names = (*NO_OUTCOME, "outcome", "reason")
    return {name: getattr(outcome, name) for name in names}


def _scores(outcome: Outcome, trial: Trial) -> dict[str, Any]:
    """Return the scores of a trial, and what they are computed from."""
    arrived = outcome.reached and not outcome.contacts
    speed_m_s, shortest_m = params_of(trial).v_max_m_s, outcome.shortest_path_m
    return {
        "top_speed_m_s": speed_m_s,
        "lap_m": lap_m(trial.world) if trial.world.reachable is False else None,
        "spl": spl(arrived, outcome.path_m, shortest_m),
        "published_score": published_score(arrived, outcome.time_s, shortest_m, speed_m_s),
    }


def _final_values(outcome: Outcome | None, watch: Behaviour) -> dict[str, Any]:
    """Return final state, true and estimated pose with covariance."""
    plant, onboard = watch.plant, watch.onboard
    if outcome is None or plant is None or onboard is None:
        names = ("true_x_m", "true_y_m", "true_heading_rad", "x_m", "y_m", "heading_rad")
        spreads = ("cov_xx_m2", "cov_xy_m2", "cov_yy_m2", "cov_hh_rad2", "mahalanobis2", "doubt_m")
        return {"goal_state": 0, "goal_reason": 0, **dict.fromkeys((*names, *spreads), nan)}
    truth, odometry = plant.truth(), onboard.state.odometry
    pose, machine_state = odometry.pose, onboard.state.machine
    off_x_m, off_y_m = truth.x_m - pose.x_m, truth.y_m - pose.y_m
    spread = (odometry.pxx, odometry.pxy, odometry.pyy)
    return {
        "goal_state": machine_state.goal_state,
        "goal_reason": machine_state.goal_reason,
        "true_x_m": truth.x_m,
        "true_y_m": truth.y_m,
        "true_heading_rad": truth.heading_rad,
        "x_m": pose.x_m,
        "y_m": pose.y_m,
        "heading_rad": pose.heading_rad,
        "cov_xx_m2": odometry.pxx,
        "cov_xy_m2": odometry.pxy,
        "cov_yy_m2": odometry.pyy,
        "cov_hh_rad2": odometry.phh,
        "mahalanobis2": mahalanobis2(off_x_m, off_y_m, spread),
        "doubt_m": nan if outcome.doubt_m is None else outcome.doubt_m,
    }


def mahalanobis2(x_m: float, y_m: float, spread_m2: tuple[float, float, float]) -> float:
    """Return (x, y) inverse(covariance) (x, y)'; NaN if the covariance is singular.

    `spread_m2` is xx, xy, yy in m².
    """
    xx, xy, yy = spread_m2
    determinant = xx * yy - xy * xy
    if not determinant > 0.0:
        return nan
    return (yy * x_m * x_m - 2.0 * xy * x_m * y_m + xx * y_m * y_m) / determinant


def _behaviour_values(watch: Behaviour) -> dict[str, Any]:
    return {
        "mean_clearance_m": watch.mean_clearance_m,
        "turned_rad": watch.turned_rad,
        "side_changes": watch.side_changes,
        "avoidances": watch.avoidances,
        "ticks_to_goal": watch.ticks_of[states.TO_GOAL],
        "ticks_passing_left": watch.ticks_of[states.PASS_LEFT],
        "ticks_passing_right": watch.ticks_of[states.PASS_RIGHT],
        "ticks_aligning": watch.ticks_of[states.ALIGN],
    }


def _now_utc() -> str:
    return datetime.now(UTC).isoformat(timespec="seconds")
