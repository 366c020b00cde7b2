"""Extract from a world's recorded facts what can be drawn, and where."""

from collections.abc import Iterator
from itertools import pairwise
from math import atan2, hypot, radians
from typing import Any, Final

from ground.recording.foxglove_schemas import Colour, Point, colour, disc, pose, vector
from ground.recording.json_schemas import Json
from protocol.ring import RADIUS_M
from runtime.files import value_in

HEIGHT_M: Final = 0.3
SKIN_M: Final = 0.02
FAINT: Final = 0.4


def facts_of(text: str) -> dict[str, Any]:
    """Return the plant's description of its world; empty when it is malformed."""
    try:
        facts: dict[str, Any] = value_in(text)
        radius_of(facts)
        for part in (start_of, outlines, discs):
            list(part(facts))
    except (ValueError, TypeError, KeyError, AttributeError):
        return {}
    return facts


def radius_of(facts: dict[str, Any]) -> float:
    """Return the robot's radius in m; a world names it only if it differs from the default."""
    return float(facts.get("robot", {}).get("radius_m", RADIUS_M))


def start_of(facts: dict[str, Any]) -> Iterator[tuple[Point, float]]:
    """Yield the start position and heading in rad, if any."""
    start = facts.get("start")
    if start:
        yield (start["x_m"], start["y_m"]), radians(start["heading_deg"])


def outlines(facts: dict[str, Any]) -> Iterator[tuple[list[Point], float]]:
    """Yield points and thickness of each wall and polygon; closed lines end where they begin."""
    if facts.get("walls") and "size_m" in facts:
        wide_m, high_m = facts["size_m"]
        corners = [(0.0, 0.0), (wide_m, 0.0), (wide_m, high_m), (0.0, high_m), (0.0, 0.0)]
        yield corners, SKIN_M
    for obstacle in facts.get("obstacles", ()):
        if "polygon_m" in obstacle:
            points = [(x_m, y_m) for x_m, y_m in obstacle["polygon_m"]]
            yield [*points, points[0]], SKIN_M
        elif "wall_m" in obstacle:
            yield [(x_m, y_m) for x_m, y_m in obstacle["wall_m"]], obstacle["thickness_m"]


def discs(facts: dict[str, Any]) -> Iterator[tuple[Point, float, list[Point]]]:
    """Yield centre, radius and path of each disc; recordings lack moving positions."""
    for obstacle in facts.get("obstacles", ()):
        if "circle_m" in obstacle:
            circle = obstacle["circle_m"]
            path = [(x_m, y_m) for x_m, y_m in obstacle.get("path_m", ())]
            yield (circle["x"], circle["y"]), circle["radius"], path


def solids(facts: dict[str, Any], tint: Colour) -> tuple[list[Json], list[Json]]:
    """Return cubes and cylinders of all obstacles; moving ones are pale, at their start."""
    cubes = [
        _side(a, b, thickness_m, tint)
        for points, thickness_m in outlines(facts)
        for a, b in pairwise(points)
    ]
    faint = (*tint[:3], FAINT)
    cylinders = [
        disc(centre, radius_m, HEIGHT_M, faint if path else tint)
        for centre, radius_m, path in discs(facts)
    ]
    return cubes, cylinders


def _side(a: Point, b: Point, thickness_m: float, tint: Colour) -> Json:
    middle = ((a[0] + b[0]) / 2.0, (a[1] + b[1]) / 2.0)
    length_m = hypot(b[0] - a[0], b[1] - a[1])
    turned_rad = atan2(b[1] - a[1], b[0] - a[0])
    return {
        "pose": pose(*middle, turned_rad, z_m=HEIGHT_M / 2.0),
        "size": vector(length_m, thickness_m, HEIGHT_M),
        "color": colour(tint),
    }
