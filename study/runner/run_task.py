"""Run one task of a study and return its row, however the trial ends.

The row has scores that other benchmarks publish, and the length of the boundary that a robot must
follow to prove that its goal is unreachable.
"""

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from datetime import UTC, datetime
from functools import lru_cache
from itertools import combinations
from math import ceil, nan, sqrt
from time import perf_counter, thread_time
from types import MappingProxyType
from typing import Any, Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from plant.model.configuration import body_of
from plant.shortest_path import Array, blocked_by
from protocol.outcome import RunOutcome
from protocol.world import Polyline, World
from robot.core import states
from robot.own_navigator import digest_of
from runtime.errors import UserError
from study.runner.plan import OwnFile, TrialTask
from study.runner.rows import COLUMNS, FAILED, CodeVersion, TrialRow, machine
from study.trial.core_loop import Behaviour
from study.trial.trial import Trial, params_of, run_trial

FINEST_M: Final = 0.02
MAX_NODES: Final = 400_000
"""On a larger floor the grid is coarser."""

RIM_M: Final = 1.0
"""Free width around a floor without outer walls."""

BAND_CELLS: Final = 2.0
"""The distance to the boundary is exact up to so many cells, which its length needs."""

OUTSIDE_CELLS: Final = 0.1
CORNERS: Final = ((0, 0), (0, 1), (1, 1), (1, 0))
NEIGHBOURS: Final = ((0, 1), (1, 0), (0, -1), (-1, 0))
DIAGONALS: Final = ((1, 1), (1, -1), (-1, 1), (-1, -1))

Mask: TypeAlias = NDArray[np.bool_]
Node: TypeAlias = tuple[int, int]


class Grid:
    """Nodes on a floor; `room_m` is their distance from the places that the robot cannot take.

    It is negative where the robot's centre cannot be, and cut off far from the boundary. A passage
    narrower than a cell may be closed in it.
    """

    def __init__(self, world: World) -> None:
        width_m, height_m = world.size_m
        rim_m = 0.0 if world.walls else RIM_M
        area_m2 = (width_m + 2 * rim_m) * (height_m + 2 * rim_m)
        self.cell_m = max(FINEST_M, sqrt(area_m2 / MAX_NODES))
        self._low_m = -rim_m - self.cell_m
        nodes = [ceil((size_m + rim_m - self._low_m) / self.cell_m) + 2 for size_m in world.size_m]
        self.xs_m, self.ys_m = (self._low_m + self.cell_m * np.arange(count) for count in nodes)
        self.room_m = np.full((len(self.xs_m), len(self.ys_m)), BAND_CELLS * self.cell_m)
        self._grow(world)

    def node(self, x_m: float, y_m: float) -> Node:
        """Return the node nearest to a place."""
        column, row = (round((value_m - self._low_m) / self.cell_m) for value_m in (x_m, y_m))
        return column, row

    def _grow(self, world: World) -> None:
        radius_m = body_of(world).radius_m
        blocked = blocked_by(world, radius_m)
        if world.walls:
            for axis, places_m in enumerate((self.xs_m, self.ys_m)):
                inside_m = np.minimum(places_m, world.size_m[axis] - places_m) - radius_m
                shape = (-1, 1) if axis == 0 else (1, -1)
                np.minimum(self.room_m, inside_m.reshape(shape), out=self.room_m)
        for centre, grown_m in zip(blocked.centres, blocked.radii.tolist(), strict=True):
            self._remove(centre, centre, grown_m)
        sizes_m = dict(
            zip(map(tuple, blocked.centres.tolist()), blocked.radii.tolist(), strict=True)
        )
        for tail, head in zip(blocked.tails, blocked.heads, strict=True):
            self._remove(tail, head, sizes_m[tuple(tail.tolist())])

    def _remove(self, a: Array, b: Array, grown_m: float) -> None:
        """Remove the places nearer than `grown_m` to a segment; a may equal b."""
        reach_m = grown_m + BAND_CELLS * self.cell_m
        low, high = np.minimum(a, b) - reach_m, np.maximum(a, b) + reach_m
        columns = slice(*np.searchsorted(self.xs_m, (low[0], high[0])).tolist())
        rows = slice(*np.searchsorted(self.ys_m, (low[1], high[1])).tolist())
        x_m, y_m = self.xs_m[columns, None] - a[0], self.ys_m[None, rows] - a[1]
        along = b - a
        length2 = float(along @ along)
        share = (
            np.clip((x_m * along[0] + y_m * along[1]) / length2, 0.0, 1.0) if length2 > 0.0 else 0.0
        )
        away_m = np.hypot(x_m - share * along[0], y_m - share * along[1]) - grown_m
        part = self.room_m[columns, rows]
        np.minimum(part, away_m, out=part)


@lru_cache(maxsize=512)
def lap_m(world: World) -> float | None:
    """Return the length of the closed boundary that separates the start from the goal, in metres.

    It is that of the free space of the robot's centre: the line that the centre follows while the
    robot touches the wall. None if the goal can be reached, or the robot does not fit at the start.
    """
    grid = Grid(world)
    start, goal = (grid.node(one.x_m, one.y_m) for one in (world.start, world.goal))
    free = grid.room_m > 0.0
    if not free[start]:
        return None
    mine = connected(free, start, NEIGHBOURS)
    if mine[goal]:
        return None
    beyond = connected(~mine, goal, (*NEIGHBOURS, *DIAGONALS))
    outside_m = np.minimum(grid.room_m, -OUTSIDE_CELLS * grid.cell_m)
    return contour_cells(np.where(mine, grid.room_m, outside_m), beyond) * grid.cell_m


def connected(open_nodes: Mask, begin: Node, steps: Iterable[Node]) -> Mask:
    """Return the open nodes that are connected with the first one by these steps."""
    padded = np.pad(open_nodes, 1)
    rows = padded.shape[1]
    unseen = bytearray(padded.astype(np.uint8).tobytes())
    jumps = [column * rows + row for column, row in steps]
    first = (begin[0] + 1) * rows + begin[1] + 1
    found = np.zeros(padded.size, dtype=np.bool_)
    pending = [first] if unseen[first] else []
    places: list[int] = []
    while pending:
        place = pending.pop()
        if not unseen[place]:
            continue
        unseen[place] = 0
        places.append(place)
        pending += [place + jump for jump in jumps if unseen[place + jump]]
    found[places] = True
    return found.reshape(padded.shape)[1:-1, 1:-1]


def contour_cells(values: Array, beyond: Mask) -> float:
    """Return the length, in cells, of the line at zero beside the nodes `beyond`.

    These are marching squares. Where two corners across are positive, the two pieces cut off the
    negative ones.
    """
    corners = [_corner(values, *corner) for corner in CORNERS]
    near = np.any([_corner(beyond, *corner) for corner in CORNERS], axis=0)
    cuts = [_cut(corners, side) for side in range(4)]
    crossed = [np.isfinite(cut[0]) for cut in cuts]
    count = np.sum(crossed, axis=0)
    total = 0.0
    for one, other in combinations(range(4), 2):
        # Side n joins corners n and n + 1, so neighbouring sides share a corner.
        shared = (one + 1) % 4 if other == one + 1 else 0
        is_piece = (count == 2) | ((count == 4) & ((other - one) % 2 == 1) & (corners[shared] < 0))
        chosen = near & crossed[one] & crossed[other] & is_piece
        (x0, y0), (x1, y1) = cuts[one], cuts[other]
        total += float(np.hypot(x1[chosen] - x0[chosen], y1[chosen] - y0[chosen]).sum())
    return total


def _corner(values: NDArray[np.generic], column: int, row: int) -> Any:
    columns, rows = values.shape
    return values[column : columns - 1 + column, row : rows - 1 + row]


def _cut(corners: list[Array], side: int) -> tuple[Array, Array]:
    """Return where the line cuts a side of each square, within it; NaN where it does not."""
    here, there = corners[side], corners[(side + 1) % 4]
    share = np.full(here.shape, np.nan)
    np.divide(here, here - there, out=share, where=(here > 0.0) != (there > 0.0))
    (x0, y0), (x1, y1) = CORNERS[side], CORNERS[(side + 1) % 4]
    return x0 + share * (x1 - x0), y0 + share * (y1 - y0)


FASTEST, SLOWEST = 2.0, 8.0
"""Limits of the time in optimal times; a robot that needs twice the optimal has the full score."""

FULL_SCORE: Final = 1.0 / FASTEST


def published_score(
    arrived: bool, time_s: float, shortest_path_m: float | None, speed_m_s: float
) -> float | None:
    """Return the score of the BARN challenge, at most `FULL_SCORE`; None without a way to the goal.

    It is success x optimal time / clip(time, 2 x optimal time, 8 x optimal time). The optimal time
    is that of the shortest path at the robot's own top speed (the challenge takes 2 m/s).
    """
    if shortest_path_m is None:
        return None
    if not arrived:
        return 0.0
    optimal_s = shortest_path_m / speed_m_s
    if optimal_s == 0.0:
        return FULL_SCORE
    return 1.0 / min(max(time_s / optimal_s, FASTEST), SLOWEST)


def spl(arrived: bool, path_m: float, shortest_path_m: float | None) -> float | None:
    """Return success weighted by path length (Anderson et al. 2018), at most 1.

    It is success x shortest path / max(path, shortest path); None without a way to the goal.
    """
    if shortest_path_m is None:
        return None
    if not arrived:
        return 0.0
    longer_m = max(path_m, shortest_path_m)
    return shortest_path_m / longer_m if longer_m > 0.0 else 1.0


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
    own: Mapping[str, OwnFile] = field(default_factory=dict)


def trial_of(
    source: TrialTask | TrialRow, world: World, own: Mapping[str, OwnFile] = MappingProxyType({})
) -> Trial:
    """Return the trial of a task, or that of a row to repeat it.

    Raises UserError if the file of an own navigator has changed since the study began.
    """
    navigator, file = source.navigator, own.get(source.navigator)
    if file is not None:
        navigator = file.reference
        if digest_of(navigator) != file.digest:
            raise UserError(f"{navigator} has changed since the study began: run the study again")
    return Trial(
        world=world,
        navigator=navigator,
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
        trial = trial_of(task, context.worlds[task.place], context.own)
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
    walls = (obstacle for obstacle in world.obstacles if isinstance(obstacle, Polyline))
    return min((wall.thickness_m for wall in walls), default=None)


def _outcome_values(outcome: RunOutcome) -> dict[str, Any]:
    """Return the values of the outcome under the names of a row."""
    names = (*NO_OUTCOME, "outcome", "reason")
    return {name: getattr(outcome, name) for name in names}


def _scores(outcome: RunOutcome, trial: Trial) -> dict[str, Any]:
    """Return the scores of a trial, and what they are computed from."""
    arrived = outcome.reached and not outcome.contacts
    speed_m_s, shortest_m = params_of(trial).v_max_m_s, outcome.shortest_path_m
    return {
        "top_speed_m_s": speed_m_s,
        "lap_m": lap_m(trial.world) if trial.world.reachable is False else None,
        "spl": spl(arrived, outcome.path_m, shortest_m),
        "published_score": published_score(arrived, outcome.time_s, shortest_m, speed_m_s),
    }


def _final_values(outcome: RunOutcome | None, watch: Behaviour) -> dict[str, Any]:
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
