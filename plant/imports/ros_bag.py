"""Make cells of a bag of ROS 2: of a map in it, else of what ranges have shown along a drive.

Without a map a cell is free if most rays through it went on, or if the robot was there. What no
sensor has seen is blocked, as unknown pixels of a map are. A sonar sees a cone, in which the place
of its echo is unknown, so corners become round.
"""

from collections.abc import Iterator, Sequence
from math import ceil, floor, inf, pi
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from plant.imports.cells import MAX_COORDINATE_M, Cells
from plant.model.errors import refuse
from protocol.ring import RADIUS_M
from protocol.ros_bag import (
    GRID,
    RANGE,
    SCAN,
    BagError,
    BagPose,
    BagRays,
    BagRobot,
    RosBag,
    robots_in,
    yaw_of,
)
from runtime.elementary import cos_sin

CELL_M: Final = 0.05
FREE_PERCENT: Final = 25
"""Occupancy up to which a cell of a map is free, as map_server has it."""

MAX_CELLS: Final = 16_000_000
FAR_SHARE: Final = 0.8
"""Share of the largest range that a ray without an echo shows to be free."""

SAMPLED: Final = (0.02, 0.02, 0.03)
SAMPLED_OF_LASER: Final = (0.1, 0.1, 0.1)
"""Metres and rad: rays of a sensor from about the same pose are used once, as they show no more."""

MAX_RAYS: Final = 1_000_000

ROUNDS: Final = 16
"""Rays whose cells are counted at once, times 1024."""

Points = NDArray[np.float64]


def load_bag(path: Path, cell_m: float | None) -> Cells:
    """Return the cells; raise WorldError. A map has cells of its own size."""
    try:
        with RosBag(path) as bag:
            if grids := bag.topics(GRID):
                if cell_m is not None:
                    raise refuse(str(path), "--cell", "its map has cells", "leave --cell out")
                return of_grid(bag, next((one for one in grids if one == "/map"), grids[0]))
            bag.require("map and no ranges", "record ranges and odometry, or a map", RANGE, SCAN)
            (robot, *_) = robots_in(bag)
            return of_drive(bag, robot, cell_m or CELL_M)
    except BagError as error:
        raise refuse(str(error.file), "bag", error.reason, error.fix) from None


def of_grid(bag: RosBag, topic: str) -> Cells:
    """Return the newest map on a topic; raise BagError."""
    newest: Any = None
    for one in bag.messages([topic]):
        newest = one.content
    if newest is None:
        raise BagError(bag.path, f"no map on {topic} can be read", "record it again")
    info = newest.info
    yaw_rad, where = yaw_of(info.origin.orientation), info.origin.position
    is_whole = info.width * info.height == len(newest.data) and len(newest.data) > 0
    if yaw_rad is None or not is_whole or not 0.001 <= info.resolution <= 10.0:
        raise BagError(bag.path, f"the map on {topic} is malformed", "record it again")
    if not max(abs(where.x), abs(where.y)) <= MAX_COORDINATE_M:
        raise BagError(bag.path, f"the map on {topic} is far away", "record it again")
    values = np.array(newest.data).reshape(info.height, info.width)
    free = (values >= 0) & (values <= FREE_PERCENT)
    if not free.any():
        raise BagError(bag.path, f"no cell of the map on {topic} is free", "record it later")
    cell_m = round(float(info.resolution), 6)
    return Cells(~free, cell_m, (float(where.x), float(where.y)), yaw_rad).trimmed()


def of_drive(bag: RosBag, robot: BagRobot, cell_m: float) -> Cells:
    """Return what the ranges of a robot have shown; raise BagError."""
    places: list[tuple[float, float]] = []
    rays: list[tuple[float, float, float, float, float]] = []
    for pose, seen in seen_from(robot):
        places.append((pose.x_m, pose.y_m))
        rays += seen
        if len(rays) > MAX_RAYS:
            reason = f"more than {MAX_RAYS} rays from places of their own"
            raise BagError(bag.path, reason, "cut it with `ros2 bag convert`")
    if not places:
        raise BagError(bag.path, f"no pose on {robot.odometry} can be read", "record it again")
    if not rays:
        names = ", ".join(sorted(robot.left_out))
        reason = "no ranges between poses" if not names else f"no transform leads to {names}"
        raise BagError(bag.path, reason, "record ranges, odometry and /tf_static together")
    return carved(bag.path, np.array(places), np.array(rays), cell_m)


def seen_from(
    robot: BagRobot,
) -> Iterator[tuple[BagPose, Sequence[tuple[float, float, float, float, float]]]]:
    """Yield each pose with the rays since the one before: origin, bearing, free length, width."""
    waiting: list[BagRays] = []
    used: set[tuple[object, ...]] = set()
    for event in robot.events():
        if isinstance(event, BagRays):
            waiting.append(event)
            continue
        found: list[tuple[float, float, float, float, float]] = []
        c, s = cos_sin(event.heading_rad)
        for seen in waiting:
            units = SAMPLED if len(seen.rays) == 1 else SAMPLED_OF_LASER
            steps = zip((event.x_m, event.y_m, event.heading_rad), units, strict=True)
            key = (seen.sensor, *(floor(value / unit) for value, unit in steps))
            if key in used:
                continue
            used.add(key)
            mount = seen.mount
            x_m = event.x_m + c * mount.x_m - s * mount.y_m
            y_m = event.y_m + s * mount.x_m + c * mount.y_m
            for bearing_rad, range_m in seen.rays:
                free_m = FAR_SHARE * seen.max_m if range_m == inf else range_m
                away_rad = event.heading_rad + mount.yaw_rad + bearing_rad
                found.append((x_m, y_m, away_rad, free_m, min(seen.width_rad, pi / 2)))
        waiting.clear()
        yield event, found


def carved(path: Path, places: Points, rays: Points, cell_m: float) -> Cells:
    """Return the floor that rays and the robot have shown to be free."""
    c, s = directions(rays[:, 2])
    ends = np.stack([rays[:, 0] + rays[:, 3] * c, rays[:, 1] + rays[:, 3] * s], axis=1)
    known = np.vstack([places, ends])
    margin_m = RADIUS_M + 2 * cell_m
    low, high = known.min(axis=0) - margin_m, known.max(axis=0) + margin_m
    columns, rows = (ceil(side) for side in ((high - low) / cell_m).tolist())
    if not columns * rows <= MAX_CELLS or np.abs(known).max() > MAX_COORDINATE_M:
        reason = f"the drive needs {columns} x {rows} cells, at most {MAX_CELLS}"
        raise refuse(str(path), "size", reason, "take larger cells with --cell")
    passed = np.zeros((rows, columns), dtype=np.int64)
    ended = np.zeros((rows, columns), dtype=np.int64)
    for begin in range(0, len(rays), ROUNDS * 1024):
        part = rays[begin : begin + ROUNDS * 1024]
        count(passed, ended, part, low, cell_m)
    free = passed > ended
    for x_m, y_m in np.unique(np.floor((places - low) / cell_m), axis=0):
        reach = ceil(RADIUS_M / cell_m)
        row, column = int(y_m), int(x_m)
        free[max(0, row - reach) : row + reach + 1, max(0, column - reach) : column + reach + 1] = (
            True
        )
    return Cells(~free, cell_m, (float(low[0]), float(low[1]))).trimmed()


def directions(angles_rad: Points) -> tuple[Points, Points]:
    """Return cosines and sines, which are the same on every machine."""
    found = np.array([cos_sin(one) for one in angles_rad.tolist()]).reshape(-1, 2)
    return found[:, 0], found[:, 1]


def count(
    passed: NDArray[np.int64],
    ended: NDArray[np.int64],
    rays: Points,
    low: Points,
    cell_m: float,
) -> None:
    """Count the rays that go on through each cell, and those that may end there."""
    x_m, y_m, away_rad, free_m, width_rad = rays.T
    longest_m = float(free_m.max())
    sides = max(1, ceil(float((width_rad * free_m).max()) / cell_m))
    for side in range(sides):
        share = 0.0 if sides == 1 else side / (sides - 1) - 0.5
        c, s = directions(away_rad + share * width_rad)
        for step in range(ceil(longest_m / cell_m) + 1):
            far_m = step * cell_m
            for cells, chosen in (
                (passed, far_m < free_m - cell_m),
                (ended, (far_m >= free_m) & (far_m < free_m + cell_m)),
            ):
                columns = ((x_m + c * far_m - low[0])[chosen] / cell_m).astype(np.int64)
                rows = ((y_m + s * far_m - low[1])[chosen] / cell_m).astype(np.int64)
                inside = (rows < cells.shape[0]) & (columns < cells.shape[1])
                inside &= (rows >= 0) & (columns >= 0)
                np.add.at(cells, (rows[inside], columns[inside]), 1)
