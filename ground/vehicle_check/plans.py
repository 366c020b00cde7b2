"""Functions that rows about plans share: the vehicle's position, its own plans, a small mission."""

from math import cos, radians
from typing import Final

from ground.vehicle_check.check import Check
from ground.vehicle_check.dialect import mavlink
from ground.vehicle_check.missions import MISSION, Item, clear, download, upload

M_PER_E7_DEGREE: Final = 0.011131949
WAYPOINT: Final = mavlink.MAV_CMD_NAV_WAYPOINT
ITEM_ACCEPTED: Final = mavlink.MAV_MISSION_ACCEPTED
NAMES: Final = {
    number: entry.name.removeprefix("MAV_MISSION_")
    for number, entry in mavlink.enums["MAV_MISSION_RESULT"].items()
}


def outcome(result: int | None) -> str:
    """Return the name of MAV_MISSION_RESULT."""
    return "no MISSION_ACK" if result is None else NAMES.get(result, f"result {result}")


def place(check: Check) -> tuple[int, int]:
    """Return the vehicle's present latitude and longitude in 1e-7 degrees; (0, 0) if unknown."""
    frames = check.main.heard("GLOBAL_POSITION_INT")
    return (frames[-1].message.lat, frames[-1].message.lon) if frames else (0, 0)


def moved(start: tuple[int, int], north_m: float, east_m: float) -> tuple[int, int]:
    """Return a place at some distance."""
    lat, lon = start
    shrink = cos(radians(lat / 1e7))
    return (
        lat + round(north_m / M_PER_E7_DEGREE),
        lon + round(east_m / M_PER_E7_DEGREE / shrink),
    )


def small_mission(check: Check, steps: int = 3, spread_m: float = 0.3) -> list[Item]:
    """Return home and some waypoints close to the vehicle."""
    home = check.main.heard("HOME_POSITION")
    here = place(check)
    first = (home[-1].message.latitude, home[-1].message.longitude) if home else here
    items = [Item(WAYPOINT, first[0], first[1], mavlink.MAV_FRAME_GLOBAL)]
    places = [moved(here, spread_m * (number % 2), 0.1 * number) for number in range(1, steps + 1)]
    return [*items, *(Item(WAYPOINT, *at) for at in places)]


def is_disarmed_or_allowed(check: Check) -> bool:
    """Return True if the judge may replace the plans of the vehicle."""
    return check.options.allow_motion or not check.is_armed


def keep(check: Check, kind: int) -> None:
    """Download the vehicle's own plan once; it is restored after the check."""
    name = f"plan {kind}"
    if name in check.facts:
        return
    own = download(check.main, kind)
    check.facts[name] = own

    def undo() -> None:
        if own is not None and own.items:
            upload(check.main, own.items, kind)
        else:
            clear(check.main, kind)

    if own is not None:
        check.restore.append(undo)


def sent(check: Check, items: list[Item], kind: int = MISSION) -> int | None:
    """Send a plan in place of the vehicle's own."""
    keep(check, kind)
    return upload(check.main, items, kind).result


def fence_around(check: Check, size_m: float = 15.0) -> list[Item]:
    """Return a square fence around the vehicle."""
    here = place(check)
    kind = mavlink.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION
    corners = ((-1, -1), (1, -1), (1, 1), (-1, 1))
    return [
        Item(kind, *moved(here, size_m * north, size_m * east), params=(4.0, 0.0, 0.0, 0.0))
        for north, east in corners
    ]


def same_places(first: list[Item], second: list[Item], skip: int = 0) -> bool:
    """Return True if two plans have equal commands, and equal positions to 2 cm."""
    near = 2
    return len(first) == len(second) and all(
        one.command == other.command
        and abs(one.x - other.x) <= near
        and abs(one.y - other.y) <= near
        for one, other in list(zip(first, second, strict=True))[skip:]
    )
