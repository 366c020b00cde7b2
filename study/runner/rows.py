"""One row per trial: request, outcome, driving statistics and provenance.

A worker process imports this module, so it does without pyarrow: see `study.runner.store`.
"""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from math import nan
from types import MappingProxyType
from typing import Final

FAILED: Final = "failed"
"""Outcome of a trial that raised an exception or whose worker process died."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TrialRow:
    """One trial. Positions are in the world frame; `true_` is from the plant, the rest estimated.

    None: unknown in principle (no path to the goal, any heading accepted). NaN: not measured, as
    the trial failed. `parameters` is a JSON object. `study.runner.sources.world_of` makes the world
    of `world_source` again. `own_contacts` are those that the robot's own motion caused.
    `mahalanobis2` is the squared true position error under the estimated covariance. `avoidances`
    counts how often avoiding began. `side_changes` counts changes between passing on the left and
    on the right. Heading for the goal between two avoidances on the same side is no change.

    `doubt_m` is the longer half axis of the confidence ellipse of the final estimate.
    `top_speed_m_s` is the robot's own. `lap_m` is the length of the boundary between the robot and
    an unreachable goal, None where there is a way. `thinnest_wall_m` is None in a world without
    walls on its floor. `spl` and `published_score` are those of `study.runner.scores`, None without
    a way to the goal; an arrival with a contact counts as none.
    """

    study: str
    trial_id: str
    world: str
    world_source: str
    family: str
    world_digest: str
    navigator: str
    side: str
    seed: int
    noise: str
    timeout_s: float
    parameters: str
    calibrated: bool

    outcome: str
    reason: str
    goal_state: int
    goal_reason: int
    time_s: float
    path_m: float
    shortest_path_m: float | None
    reachable: bool | None
    lap_m: float | None
    thinnest_wall_m: float | None
    top_speed_m_s: float
    spl: float | None
    published_score: float | None
    position_error_m: float
    heading_error_rad: float | None
    estimated_position_error_m: float
    min_clearance_m: float
    mean_clearance_m: float
    contacts: int
    own_contacts: int
    ticks: int
    digest: str
    wall_s: float
    cpu_s: float

    true_x_m: float
    true_y_m: float
    true_heading_rad: float
    x_m: float
    y_m: float
    heading_rad: float
    cov_xx_m2: float
    cov_xy_m2: float
    cov_yy_m2: float
    cov_hh_rad2: float
    mahalanobis2: float
    doubt_m: float

    turned_rad: float
    side_changes: int
    avoidances: int
    ticks_to_goal: int
    ticks_passing_left: int
    ticks_passing_right: int
    ticks_aligning: int

    commit: str
    dirty: bool
    version: str
    python: str
    numpy: str
    pymunk: str
    platform: str
    machine: str
    started_utc: str


COLUMNS: Final = tuple(field.name for field in fields(TrialRow))

ADDED: Final[Mapping[str, float | None]] = MappingProxyType(
    {
        **dict.fromkeys(("lap_m", "thinnest_wall_m", "spl", "published_score")),
        **dict.fromkeys(("top_speed_m_s", "doubt_m"), nan),
    }
)
"""Columns that results of earlier versions lack, with the value of their rows."""
