"""Read and write QGroundControl's `.plan`: JSON with items, a fence and a planned home.

Source: docs.qgroundcontrol.com, "Plan File Format", version 1.
"""

import json
from collections.abc import Iterator
from math import isfinite, nan
from typing import Any, Final, TypeVar

import msgspec

from ground.missions.geography import to_global, to_local
from ground.missions.items import Item, home_at, item_of
from ground.missions.mission import Circle, Fence, Home, Mission, Polygon
from ground.missions.outline import fault_of
from ground.missions.problems import MissionError, Problem
from ground.missions.sift import DROP, Foreign, PlanFilter
from protocol.wire.enums import TYPE_GROUND_ROVER, Command
from runtime.errors import UserError
from runtime.files import value_in

T = TypeVar("T")
PLAN_VERSION: Final = 1
PART_VERSION: Final = 2
FIRMWARE_ARDUPILOT: Final = 3
ALTITUDE_RELATIVE: Final = 1


def read_text(text: str, file: str, *, home: Home | None = None, drop: bool = False) -> Foreign:
    """Return the mission of a plan; `home` replaces the plan's own."""
    plan = _object(text, file)
    body = plan.get("mission")
    if plan.get("fileType") != "Plan" or not isinstance(body, dict):
        problem = Problem("fileType", "this is not a plan", "save it as a .plan in QGroundControl")
        raise MissionError(file, [problem])
    home = home or _home(body.get("plannedHomePosition"), file)
    sieve = PlanFilter(file, drop=drop)
    listed = body.get("items")
    waypoints = sieve.waypoints(_items(listed if isinstance(listed, list) else [], drop), home)
    fence = _fence(plan.get("geoFence"), home, sieve)
    points = plan.get("rallyPoints")
    if isinstance(points, dict) and points.get("points"):
        sieve.refuse("rallyPoints", "the robot does not support rally points")
    return sieve.result(Mission(waypoints=tuple(waypoints), fence=fence, home=home))


def _object(text: str, file: str) -> dict[str, Any]:
    try:
        plan = value_in(text)
    except ValueError as error:
        problem = Problem("", f"is not JSON: {error}", "save it again in QGroundControl")
        raise MissionError(file, [problem]) from error
    return plan if isinstance(plan, dict) else {}


def _home(place: object, file: str) -> Home | None:
    numbers = _numbers(place)
    if len(numbers) < 2 or not any(numbers[:2]):
        return None
    try:
        return home_at(*numbers[:2])
    except UserError as error:
        problem = Problem("plannedHomePosition", str(error), "or use --home")
        raise MissionError(file, [problem]) from error


def _items(listed: list[Any], drop: bool) -> Iterator[Item | Problem]:
    """Yield the items, numbered from 1 as in QGroundControl."""
    for number, one in enumerate(listed, start=1):
        kind = one.get("type") if isinstance(one, dict) else None
        if kind != "SimpleItem":
            pattern = one.get("complexItemType", "") if isinstance(one, dict) else ""
            words = f"{kind} {pattern}".strip() if kind else "not an item"
            reason = f"{words}: the robot only drives to waypoints"
            yield Problem(f"item {number}", reason, "" if drop else DROP)
            continue
        command, frame = one.get("command"), one.get("frame")
        numbers = tuple(_numbers(one.get("params")))
        yield Item(number, _whole(command), _whole(frame), numbers)


def _whole(value: object) -> int:
    return value if isinstance(value, int) and not isinstance(value, bool) else -1


def _numbers(values: object) -> list[float]:
    """Return numbers; null and anything else becomes NaN, as in MAVLink."""
    if not isinstance(values, list):
        return []
    return [_number(value) for value in values]


def _number(value: object) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        return nan
    try:
        return float(value)
    except OverflowError:
        return nan


def _fence(part: object, home: Home | None, sieve: PlanFilter) -> Fence | None:
    """Return the circle or polygon to stay in; other shapes are rejected."""
    shapes = list(_shapes(part))
    for where, shape in shapes:
        if not shape.get("inclusion", True):
            sieve.refuse(where, "keeps the robot out: only a fence to stay in is supported")
    inside = [(where, shape) for where, shape in shapes if shape.get("inclusion", True)]
    for where, _ in inside[1:]:
        sieve.refuse(where, "is a second fence: only one is supported")
    if not inside:
        return None
    where, shape = inside[0]
    if home is None:
        sieve.refuse(where, "latitude and longitude need a home: --home LATITUDE LONGITUDE")
        return None
    fence = _circle(shape, home) if "circle" in shape else _polygon(shape, home)
    fault = fault_of(fence.corners) if isinstance(fence, Polygon) else ""
    if fence is None or fault:
        sieve.refuse(where, fault or "cannot be read")
        return None
    return fence


def _shapes(part: object) -> Iterator[tuple[str, dict[str, Any]]]:
    for kind in ("circles", "polygons"):
        listed = part.get(kind) if isinstance(part, dict) else None
        for at, shape in enumerate(listed if isinstance(listed, list) else []):
            yield f"geoFence.{kind}[{at}]", shape if isinstance(shape, dict) else {}


def _circle(shape: dict[str, Any], home: Home) -> Circle | None:
    circle = shape["circle"]
    centre = _numbers(circle.get("center")) if isinstance(circle, dict) else []
    radius_m = _number(circle.get("radius")) if isinstance(circle, dict) else nan
    if len(centre) < 2 or not all(map(isfinite, (*centre[:2], radius_m))):
        return None
    x_m, y_m = to_local(home, *centre[:2])
    return _fitting({"x_m": x_m, "y_m": y_m, "radius_m": radius_m}, Circle)


def _polygon(shape: dict[str, Any], home: Home) -> Polygon | None:
    listed = shape.get("polygon")
    corners = [_numbers(one)[:2] for one in listed] if isinstance(listed, list) else []
    if any(len(corner) != 2 or not all(map(isfinite, corner)) for corner in corners):
        return None
    return _fitting({"corners": [to_local(home, *corner) for corner in corners]}, Polygon)


def _fitting(table: dict[str, Any], schema: type[T]) -> T | None:
    """Return None when a value is out of range."""
    try:
        return msgspec.convert(table, schema)
    except msgspec.ValidationError:
        return None


def text_of(mission: Mission, home: Home) -> str:
    """Return a plan for a rover as QGroundControl writes it."""
    items = [_item(item_of(at, one, home)) for at, one in enumerate(mission.waypoints, start=1)]
    plan = {
        "fileType": "Plan",
        "geoFence": _fence_part(mission.fence, home),
        "groundStation": "Sidestep",
        "mission": {
            "cruiseSpeed": 0.3,
            "firmwareType": FIRMWARE_ARDUPILOT,
            "globalPlanAltitudeMode": ALTITUDE_RELATIVE,
            "hoverSpeed": 0.3,
            "items": items,
            "plannedHomePosition": [home.latitude_deg, home.longitude_deg, 0.0],
            "vehicleType": TYPE_GROUND_ROVER,
            "version": PART_VERSION,
        },
        "rallyPoints": {"points": [], "version": PART_VERSION},
        "version": PLAN_VERSION,
    }
    return json.dumps(plan, indent=4, allow_nan=False) + "\n"


def _item(item: Item) -> dict[str, object]:
    return {
        "AMSLAltAboveTerrain": None,
        "Altitude": 0,
        "AltitudeMode": ALTITUDE_RELATIVE,
        "autoContinue": True,
        "command": Command.NAV_WAYPOINT,
        "doJumpId": item.number,
        "frame": item.frame,
        "params": [value if isfinite(value) else None for value in item.params],
        "type": "SimpleItem",
    }


def _fence_part(fence: Fence | None, home: Home) -> dict[str, object]:
    circles: list[object] = []
    polygons: list[object] = []
    if isinstance(fence, Circle):
        centre = list(to_global(home, fence.x_m, fence.y_m))
        circle = {"center": centre, "radius": fence.radius_m}
        circles.append({"circle": circle, "inclusion": True, "version": 1})
    elif fence is not None:
        corners = [list(to_global(home, *corner)) for corner in fence.corners]
        polygons.append({"inclusion": True, "polygon": corners, "version": 1})
    return {"circles": circles, "polygons": polygons, "version": PART_VERSION}
