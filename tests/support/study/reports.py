"""Synthetic trials and contacts for tests of the report."""

from collections.abc import Sequence
from hashlib import sha256
from itertools import pairwise, product
from typing import Any

import pyarrow as pa

from protocol.outcome import Outcome
from protocol.wire.reasons import Reason
from protocol.world import Circle, Point, World
from robot.core.states import TO_GOAL
from robot.core.values import Pose as CorePose
from study.report.contact_kinds import RecordedTick, StoredPoint, Touched
from study.report.drives import DrivenTrial, Pose
from study.report.trials import Trials, trials_of
from study.runner.rows import TrialRow
from study.runner.run_task import published_score, spl
from study.runner.store import SCHEMA, table_of
from study.trial.trial import Trial
from tests.support.study.made import floor

USUAL: dict[str, Any] = {
    "study": "test",
    "world": "box_1_000",
    "world_source": "corpus:box:1:0",
    "family": "box",
    "navigator": "vgm_memory",
    "side": "left",
    "seed": 0,
    "noise": "default",
    "timeout_s": 300.0,
    "parameters": "{}",
    "calibrated": True,
    "outcome": "reached",
    "reason": "none",
    "goal_state": 5,
    "goal_reason": 0,
    "time_s": 30.0,
    "path_m": 5.5,
    "shortest_path_m": 5.0,
    "reachable": True,
    "lap_m": None,
    "thinnest_wall_m": None,
    "top_speed_m_s": 0.3,
    "position_error_m": 0.05,
    "heading_error_rad": 0.02,
    "estimated_position_error_m": 0.04,
    "min_clearance_m": 0.1,
    "mean_clearance_m": 0.6,
    "contacts": 0,
    "own_contacts": 0,
    "ticks": 600,
    "wall_s": 0.5,
    "cpu_s": 0.4,
    "true_x_m": 5.0,
    "true_y_m": 2.0,
    "true_heading_rad": 0.0,
    "x_m": 5.0,
    "y_m": 2.0,
    "heading_rad": 0.0,
    "cov_xx_m2": 0.01,
    "cov_xy_m2": 0.0,
    "cov_yy_m2": 0.01,
    "cov_hh_rad2": 0.001,
    "mahalanobis2": 1.0,
    "doubt_m": 0.2,
    "turned_rad": 3.0,
    "side_changes": 0,
    "avoidances": 1,
    "ticks_to_goal": 400,
    "ticks_passing_left": 100,
    "ticks_passing_right": 80,
    "ticks_aligning": 20,
    "commit": "c0ffee",
    "dirty": False,
    "version": "0.1.0",
    "python": "3.11.0",
    "numpy": "2.0.0",
    "pymunk": "7.0.0",
    "platform": "Linux",
    "machine": "a processor",
    "started_utc": "2026-01-01T00:00:00+00:00",
}


def row(**changes: Any) -> TrialRow:
    """Return a successful trial with changed values; its id depends on its values."""
    fields = {**USUAL, **changes}
    mark = sha256(repr(sorted(fields.items())).encode()).hexdigest()
    fields.setdefault("world_digest", sha256(fields["world"].encode()).hexdigest())
    arrived = fields["outcome"] == "reached" and not fields["contacts"]
    shortest_m = fields["shortest_path_m"]
    fields.setdefault("spl", spl(arrived, fields["path_m"], shortest_m))
    scored = published_score(arrived, fields["time_s"], shortest_m, fields["top_speed_m_s"])
    fields.setdefault("published_score", scored)
    return TrialRow(**{"trial_id": mark[:32], "digest": mark, **fields})


STUCK: dict[str, Any] = {"outcome": "stuck", "reason": "has come no closer for too long"}
GAVE_UP: dict[str, Any] = {
    "outcome": "unreachable",
    "reason": "unreachable: a closed boundary separates robot and goal",
    "goal_reason": int(Reason.UNREACHABLE),
}
COLLIDED: dict[str, Any] = {"outcome": "collided", "contacts": 1, "own_contacts": 1}
SHUT: dict[str, Any] = {
    "world": "unreachable_1_000",
    "family": "unreachable",
    "reachable": False,
    "world_source": "corpus:unreachable:1:0",
    "shortest_path_m": None,
    "lap_m": 12.0,
}
LOST: dict[str, Any] = {
    "outcome": "lost",
    "reason": "lost: found no way; position doubt 0.42 m",
    "goal_reason": int(Reason.LOST),
    "doubt_m": 0.42,
}


def trials(*rows: TrialRow) -> Trials:
    return trials_of(table_of(list(rows)))


def study(
    navigators: Sequence[str] = ("bug", "vgm", "vgm_memory"),
    noises: Sequence[str] = ("none", "default"),
    failing: bool = True,
) -> pa.Table:
    """Return trials in ten worlds with a path and one without; vgm and bug fail in some."""
    rows: list[TrialRow] = []
    families = ("box", "corner", "u_trap", "forest_dense", "moving")
    for navigator, noise, (place, family), number in product(
        navigators, noises, enumerate(families), range(2)
    ):
        bad = failing and navigator != "vgm_memory" and (place + number) % 3 == 0
        ending = (STUCK, COLLIDED, GAVE_UP)[place % 3] if bad else {}
        name, source = f"{family}_1_{number:03d}", f"corpus:{family}:1:{number}"
        request = {"navigator": navigator, "noise": noise, "world": name, "family": family}
        path_m = 5.2 + 0.1 * place + 0.3 * len(navigator)
        rows.append(row(**{**request, "world_source": source, "path_m": path_m, **ending}))
    rows += [
        row(**{"navigator": navigator, "noise": noise, **SHUT, **GAVE_UP})
        for navigator, noise in product(navigators, noises)
    ]
    return table_of(rows)


def without_values(table: pa.Table) -> pa.Table:
    """Return the table with nulls or NaN wherever the schema allows."""
    nulls = {field.name for field in SCHEMA if field.nullable}
    columns = {}
    for field in SCHEMA:
        values = table.column(field.name)
        if field.name in nulls:
            values = pa.nulls(table.num_rows, field.type)
        elif pa.types.is_floating(field.type):
            values = pa.array([float("nan")] * table.num_rows, field.type)
        columns[field.name] = values
    return pa.table(columns)


def drive(
    path: Sequence[Pose],
    branches: Sequence[int] | None = None,
    *,
    world: World | None = None,
    outcome: str = "reached",
    contacts: int = 0,
    **request: Any,
) -> DrivenTrial:
    """Return a drive along these poses, with a perfect estimate."""
    place = world or floor(far_m=2.0)
    trial = Trial(world=place, **{"navigator": "vgm", "noise": "none", **request})
    return DrivenTrial(
        trial=trial,
        outcome=ended(trial, path, outcome, contacts),
        true=tuple(path),
        believed=tuple(path),
        branches=tuple(branches or [1] * len(path)),
        covariance=(0.01, 0.0, 0.04),
    )


def ended(trial: Trial, path: Sequence[Pose], outcome: str, contacts: int) -> Outcome:
    """Return the outcome of a trial along this path."""
    way_m = sum(abs(complex(b[0] - a[0], b[1] - a[1])) for a, b in pairwise(path))
    return Outcome(
        world=trial.world.name,
        navigator=trial.navigator,
        seed=trial.seed,
        noise=str(trial.noise),
        wall_s=0.1,
        outcome=outcome,
        reason="none",
        time_s=10.0,
        path_m=way_m,
        shortest_path_m=trial.world.shortest_path_m,
        position_error_m=0.0,
        heading_error_rad=None,
        estimated_position_error_m=0.0,
        min_clearance_m=0.2,
        contacts=contacts,
        own_contacts=contacts,
        ticks=len(path),
        missed_ticks=0,
        digest="d1",
    )


RADIUS_M = 0.12
ORIGIN = CorePose(0.0, 0.0, 0.0)
NO_ECHO = (None,) * 8
AHEAD = Touched("wall of 2 mm", (RADIUS_M, 0.0), is_edge=True)


def tick(time_s: float, **changes: Any) -> RecordedTick:
    """Return a tick of a robot at the origin that has measured and remembered nothing."""
    usual: dict[str, Any] = {
        "true": ORIGIN,
        "estimated": ORIGIN,
        "clearance_m": 0.1,
        "branch": TO_GOAL,
        "guard": 0,
        "speed_m_s": 0.3,
        "yaw_rate_rad_s": 0.0,
        "range_m": NO_ECHO,
        "points": (),
    }
    return RecordedTick(time_s=time_s, **{**usual, **changes})


def stored(x_m: float, y_m: float = 0.0, counts: bool = True) -> dict[str, Any]:
    """Return the change of a tick that remembers one point."""
    return {"points": (StoredPoint(x_m, y_m, counts),)}


def echo(sonar: int, range_m: float) -> dict[str, Any]:
    """Return the change of a tick in which one sonar has an echo."""
    ranges: list[float | None] = [None] * 8
    ranges[sonar] = range_m
    return {"range_m": tuple(ranges)}


def person(start: Point, end: Point) -> Circle:
    """Return a person who walks at 0.1 m/s."""
    return Circle(x_m=start[0], y_m=start[1], radius_m=0.2, path_m=(start, end), speed_m_s=0.1)
