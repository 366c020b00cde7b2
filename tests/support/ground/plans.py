"""A plan for a rover as QGroundControl writes it, with all that people draw."""

from typing import Any

HOME = [47.4, 8.5, 400.5]


def at(north: int, east: int) -> tuple[float, float]:
    """Return the place so many 1e-7 degrees (1.1 cm and 0.75 cm) from home."""
    return round(47.4 + north / 1e7, 7), round(8.5 + east / 1e7, 7)


def placed(
    command: int, *params: float | None, north: int, east: int, up_m: float = 10, frame: int = 3
) -> dict[str, Any]:
    return {
        "AMSLAltAboveTerrain": None,
        "Altitude": up_m,
        "AltitudeMode": {0: 2, 3: 1, 10: 4}[frame],
        "autoContinue": True,
        "command": command,
        "frame": frame,
        "params": [*params, *at(north, east), up_m],
        "type": "SimpleItem",
    }


def order(command: int, *params: float) -> dict[str, Any]:
    return {
        "autoContinue": True,
        "command": command,
        "frame": 2,
        "params": [*params, *[0] * (7 - len(params))],
        "type": "SimpleItem",
    }


TRANSECTS = [placed(16, 0, 0, 0, None, north=20 * k, east=380, up_m=50) for k in (1, 2, 3)]
SURVEY = {
    "TransectStyleComplexItem": {
        "CameraCalc": {"CameraName": "Manual (no camera specs)", "version": 2},
        "CameraShots": 12,
        "Items": [TRANSECTS[0], order(206, 0.5, 0, 1), *TRANSECTS[1:], order(206, 0, 0, 1)],
        "Refly90Degrees": False,
        "TurnAroundDistance": 0,
        "VisualTransectPoints": [list(at(20 * k, 380)) for k in (1, 2, 3)],
        "version": 2,
    },
    "angle": 0,
    "complexItemType": "survey",
    "polygon": [list(at(*corner)) for corner in ((0, 370), (80, 370), (80, 390))],
    "type": "ComplexItem",
    "version": 5,
}
ITEMS = [
    order(178, 1, 0.2, -1),
    placed(16, 0, 0, 0, None, north=0, east=300),
    placed(16, 1.5, 3, 0, 0, north=0, east=360, up_m=12.5, frame=0),
    order(93, 2, -1, -1, -1),
    order(177, 2, 1),
    order(178, 1, -2, -1),
    placed(19, 1, 0, 0, 1, north=0, east=400),
    SURVEY,
    placed(16, 0, 0.1, 0, 270, north=0, east=100, frame=10),
    order(20),
]


def numbered(items: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return the items with the numbers that QGroundControl gives: a survey counts its own."""
    number, found = 1, []
    for item in items:
        body = item.get("TransectStyleComplexItem")
        if body is None:
            found.append({**item, "doJumpId": number})
            number += 1
        else:
            inner = [{**one, "doJumpId": number + k} for k, one in enumerate(body["Items"])]
            found.append({**item, "TransectStyleComplexItem": {**body, "Items": inner}})
            number += len(inner)
    return found


def plan_of(items: list[dict[str, Any]], fence: dict[str, Any] | None = None) -> dict[str, Any]:
    return {
        "fileType": "Plan",
        "geoFence": fence or {"circles": [], "polygons": [], "version": 2},
        "groundStation": "QGroundControl",
        "mission": {
            "cruiseSpeed": 5,
            "firmwareType": 3,
            "globalPlanAltitudeMode": 1,
            "hoverSpeed": 5,
            "items": numbered(items),
            "plannedHomePosition": HOME,
            "vehicleType": 10,
            "version": 2,
        },
        "rallyPoints": {"points": [], "version": 2},
        "version": 1,
    }


FLAT = numbered([*ITEMS[:7], *TRANSECTS, *ITEMS[8:]])
"""The items of the plan that the robot drives: those of the survey without the camera's."""
