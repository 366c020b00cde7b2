"""One row per trial: request, outcome, driving statistics and provenance."""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from math import nan
from types import MappingProxyType, UnionType
from typing import Any, Final, get_args, get_type_hints

import pyarrow as pa

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

_ARROW: Final[Mapping[type, Any]] = MappingProxyType(
    {str: pa.string(), bool: pa.bool_(), int: pa.int64(), float: pa.float64()}
)


def _column(name: str, kind: Any) -> Any:
    """Return a column that holds nulls where its annotation allows None."""
    nullable = isinstance(kind, UnionType)
    plain = get_args(kind)[0] if nullable else kind
    return pa.field(name, _ARROW[plain], nullable=nullable)


SCHEMA: Final = pa.schema([_column(name, kind) for name, kind in get_type_hints(TrialRow).items()])


def table_of(rows: list[TrialRow]) -> pa.Table:
    """Return the rows as a table in their order.

    Raises ValueError, naming the column, where a value is missing.
    """
    columns = {name: [getattr(row, name) for row in rows] for name in COLUMNS}
    for field in SCHEMA:
        if not field.nullable and None in columns[field.name]:
            raise ValueError(f"{field.name}: a row without a value")
    return pa.table(columns, schema=SCHEMA)


def with_added(table: pa.Table) -> pa.Table:
    """Return a table of an earlier version with the columns that were added since, in order.

    A table that lacks other columns, or has others, is returned as it is.
    """
    missing = [name for name in COLUMNS if name not in table.column_names]
    if not set(missing) <= set(ADDED) or not set(table.column_names) <= set(COLUMNS):
        return table
    for name in missing:
        values = pa.array([ADDED[name]] * table.num_rows, SCHEMA.field(name).type)
        table = table.append_column(SCHEMA.field(name), values)
    return table.select(list(COLUMNS)) if missing else table


def rows_of(table: pa.Table) -> list[TrialRow]:
    """Return the rows of a table that has the schema."""
    return [TrialRow(**record) for record in table.to_pylist()]
