"""Functions that rows about plans share: the vehicle's position, its own plans, a small mission."""

from functools import partial
from math import cos, radians
from typing import Final

from vehicle_check.check import Check, Restore
from vehicle_check.dialect import mavlink
from vehicle_check.missions import FENCE, MISSION, Item, clear, download, upload
from vehicle_check.parameters import read

M_PER_E7_DEGREE: Final = 0.011131949
WAYPOINT: Final = mavlink.MAV_CMD_NAV_WAYPOINT
HOME: Final = mavlink.MAVLINK_MSG_ID_HOME_POSITION
KIND_NAMES: Final = {MISSION: "mission", FENCE: "fence"}
STEP_M: Final = 0.4
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
    frame = check.main.latest("GLOBAL_POSITION_INT")
    return (0, 0) if frame is None else (frame.message.lat, frame.message.lon)


def home(check: Check) -> tuple[int, int] | None:
    """Return the vehicle's home; ask for it if it does not send it by itself."""
    frame = check.main.latest("HOME_POSITION") or check.main.request(HOME, "HOME_POSITION")
    return None if frame is None else (frame.message.latitude, frame.message.longitude)


def moved(start: tuple[int, int], north_m: float, east_m: float) -> tuple[int, int]:
    """Return a place at some distance."""
    lat, lon = start
    shrink = cos(radians(lat / 1e7))
    return (
        lat + round(north_m / M_PER_E7_DEGREE),
        lon + round(east_m / M_PER_E7_DEGREE / shrink),
    )


def step_m(check: Check) -> float:
    """Return a step that is longer than the radius in which a place counts as reached."""

    def find() -> float:
        radius = read(check.main, "WP_RADIUS")
        return STEP_M if radius is None else max(STEP_M, 2 * float(radius.param_value) + 1)

    return check.once("step", find)


def small_mission(check: Check, steps: int = 3, spread_m: float = 0.3) -> list[Item]:
    """Return home and some waypoints close to the vehicle."""
    here = place(check)
    items = [Item(WAYPOINT, *(home(check) or here), mavlink.MAV_FRAME_GLOBAL)]
    places = [moved(here, spread_m * (number % 2), 0.1 * number) for number in range(1, steps + 1)]
    return [*items, *(Item(WAYPOINT, *at) for at in places)]


def is_disarmed_or_allowed(check: Check) -> bool:
    """Return True if the judge may replace the plans of the vehicle."""
    return check.options.allow_motion or not check.is_armed


def keep(check: Check, kind: int) -> bool:
    """Download the vehicle's own plan once; it is restored after the check.

    Return False if it cannot be read: then it must not be replaced.
    """
    name = f"plan {kind}"
    if name not in check.facts:
        own = check.facts[name] = download(check.main, kind)
        if own is not None:
            undo = partial(_sent_back, check, own.items, kind)
            check.restore.append(Restore(KIND_NAMES[kind], undo))
    return check.facts[name] is not None


def _sent_back(check: Check, items: list[Item], kind: int) -> bool:
    found = upload(check.main, items, kind).result if items else clear(check.main, kind)
    return bool(found == ITEM_ACCEPTED)


def sent(check: Check, items: list[Item], kind: int = MISSION) -> int | None:
    """Send a plan in place of the vehicle's own; None if that cannot be kept."""
    return upload(check.main, items, kind).result if keep(check, kind) else None


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
