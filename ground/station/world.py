"""Parse the plant's description of its world: simulated truth, for the map only."""

from collections.abc import Sequence
from itertools import pairwise
from math import dist, radians
from typing import Any, Final, NamedTuple

from ground.map.scene import Disc, MapTarget, Outline, Shape
from protocol.ring import RADIUS_M
from runtime.cli.terminal import printable
from runtime.errors import RemoteError
from runtime.files import value_in

Point = tuple[float, float]
MAX_NUMBER: Final = 1e6
"""Limit for metres, degrees and m/s; larger values cannot be drawn."""

MAX_NAME: Final = 64
MAX_OBSTACLES: Final = 4000
MAX_POINTS: Final = 100_000


class Mover(NamedTuple):
    """A disc that moves back and forth along its waypoints."""

    radius_m: float
    speed_m_s: float
    path_m: tuple[Point, ...]

    def at(self, time_s: float) -> Disc:
        """Return its position at this simulated time."""
        lengths_m = [dist(a, b) for a, b in pairwise(self.path_m)]
        whole_m = sum(lengths_m)
        if whole_m <= 0.0:
            return Disc(*self.path_m[0], self.radius_m)
        gone_m = (time_s * self.speed_m_s) % (2.0 * whole_m)
        along_m = min(gone_m, 2.0 * whole_m - gone_m)
        for (a, b), length_m in zip(pairwise(self.path_m), lengths_m, strict=True):
            if along_m <= length_m and length_m > 0.0:
                share = along_m / length_m
                return Disc(
                    a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1]), self.radius_m
                )
            along_m -= length_m
        return Disc(*self.path_m[-1], self.radius_m)


class WorldFacts(NamedTuple):
    """A world in metres and radians; `text` is the plant's JSON, for trials in this world."""

    name: str
    size_m: Point
    obstacles: tuple[Shape, ...]
    movers: tuple[Mover, ...]
    start: tuple[float, float, float]
    goal: MapTarget
    radius_m: float
    text: str


def parse_world(answer: bytes | str) -> WorldFacts:
    """Parse the answer of the WORLD service; RemoteError when it is malformed."""
    text = answer.decode(errors="replace") if isinstance(answer, bytes) else answer
    try:
        found = value_in(text)
        return _facts(found, text)
    except (ValueError, KeyError, TypeError, IndexError, AttributeError) as error:
        raise RemoteError(f"the plant's world cannot be read: {error!r}") from error


def _facts(found: dict[str, Any], text: str) -> WorldFacts:
    width_m, height_m = map(_number, found["size_m"])
    obstacles = found["obstacles"]
    _check_size(obstacles)
    moving = [one for one in obstacles if "path_m" in one]
    shapes = [_shape(one) for one in obstacles if "path_m" not in one]
    if found.get("walls", True):
        corners = (0.0, 0.0), (width_m, 0.0), (width_m, height_m), (0.0, height_m)
        shapes.insert(0, Outline(corners))
    start = found["start"]
    x_m, y_m = _number(start["x_m"]), _number(start["y_m"])
    return WorldFacts(
        name=printable(str(found["name"])[:MAX_NAME]),
        size_m=(width_m, height_m),
        obstacles=tuple(shapes),
        movers=tuple(_mover(one) for one in moving),
        start=(x_m, y_m, radians(_number(start["heading_deg"]))),
        goal=_goal(found["goal"]),
        radius_m=_number(found.get("robot", {}).get("radius_m", RADIUS_M)),
        text=text,
    )


def _check_size(obstacles: list[dict[str, Any]]) -> None:
    """Raise ValueError for more obstacles or points than can be drawn."""
    lists = [one.get(key, ()) for one in obstacles for key in ("polygon_m", "wall_m", "path_m")]
    if len(obstacles) > MAX_OBSTACLES or sum(map(len, lists)) > MAX_POINTS:
        raise ValueError("too many obstacles or points")


def _number(value: Any) -> float:
    """Return a number; ValueError when it cannot be drawn."""
    number = float(value)
    if not abs(number) <= MAX_NUMBER:
        raise ValueError(f"{number} is out of range")
    return number


def _goal(goal: dict[str, Any]) -> MapTarget:
    heading_deg = goal.get("heading_deg")
    return MapTarget(
        _number(goal["x_m"]),
        _number(goal["y_m"]),
        None if heading_deg is None else radians(_number(heading_deg)),
        _number(goal.get("position_tolerance_m", 0.0)),
    )


def _points(points: Sequence[Sequence[float]]) -> tuple[Point, ...]:
    return tuple((_number(x_m), _number(y_m)) for x_m, y_m in points)


def _shape(one: dict[str, Any]) -> Shape:
    if "polygon_m" in one:
        return Outline(_points(one["polygon_m"]))
    if "wall_m" in one:
        return Outline(_points(one["wall_m"]), closed=False)
    disc = one["circle_m"]
    return Disc(_number(disc["x"]), _number(disc["y"]), _number(disc["radius"]))


def _mover(one: dict[str, Any]) -> Mover:
    path_m = _points(one["path_m"])
    if not path_m:
        raise ValueError("path_m is empty")
    return Mover(_number(one["circle_m"]["radius"]), _number(one["speed_m_s"]), path_m)
