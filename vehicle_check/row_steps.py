"""Steps that rows share: position, own plans, a small mission; arm, drive, measure, stop."""

from collections.abc import Callable
from functools import partial
from math import cos, hypot, radians, sin
from typing import Any, Final

from vehicle_check.ground_stations import result_name
from vehicle_check.mavlink_frames import MavMessage, mavlink
from vehicle_check.transfers import (
    FENCE,
    MISSION,
    PlanItem,
    clear_plan,
    download_plan,
    read_parameter,
    upload_plan,
)
from vehicle_check.vehicle_under_test import Findings, VehicleChange, VehicleCheck

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


def plan_result_name(result: int | None) -> str:
    """Return the name of MAV_MISSION_RESULT."""
    return "no MISSION_ACK" if result is None else NAMES.get(result, f"result {result}")


def place(check: VehicleCheck) -> tuple[int, int]:
    """Return the vehicle's present latitude and longitude in 1e-7 degrees; (0, 0) if unknown."""
    frame = check.main.latest("GLOBAL_POSITION_INT")
    return (0, 0) if frame is None else (frame.message.lat, frame.message.lon)


def home(check: VehicleCheck) -> tuple[int, int] | None:
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


def step_m(check: VehicleCheck) -> float:
    """Return a step that is longer than the radius in which a place counts as reached."""

    def find() -> float:
        radius = read_parameter(check.main, "WP_RADIUS")
        return STEP_M if radius is None else max(STEP_M, 2 * float(radius.param_value) + 1)

    return check.once("step", find)


def small_mission(check: VehicleCheck, steps: int = 3, spread_m: float = 0.3) -> list[PlanItem]:
    """Return home and some waypoints close to the vehicle."""
    here = place(check)
    items = [PlanItem(WAYPOINT, *(home(check) or here), mavlink.MAV_FRAME_GLOBAL)]
    places = [moved(here, spread_m * (number % 2), 0.1 * number) for number in range(1, steps + 1)]
    return [*items, *(PlanItem(WAYPOINT, *at) for at in places)]


def is_disarmed_or_allowed(check: VehicleCheck) -> bool:
    """Return True if the judge may replace the plans of the vehicle."""
    return check.options.allow_motion or not check.is_armed


def keep_plan(check: VehicleCheck, kind: int) -> bool:
    """Download the vehicle's own plan once; it is restored after the check.

    Return False if it cannot be read: then it must not be replaced.
    """
    name = f"plan {kind}"
    if name not in check.facts:
        own = check.facts[name] = download_plan(check.main, kind)
        if own is not None:
            undo = partial(_sent_back, check, own.items, kind)
            check.restore.append(VehicleChange(KIND_NAMES[kind], undo))
    return check.facts[name] is not None


def _sent_back(check: VehicleCheck, items: list[PlanItem], kind: int) -> bool:
    found = upload_plan(check.main, items, kind).result if items else clear_plan(check.main, kind)
    return bool(found == ITEM_ACCEPTED)


def send_plan(check: VehicleCheck, items: list[PlanItem]) -> int | None:
    """Send a mission in place of the vehicle's own; None if that cannot be kept."""
    return upload_plan(check.main, items).result if keep_plan(check, MISSION) else None


FENCE_M: Final = 15.0


def fence_around(check: VehicleCheck) -> list[PlanItem]:
    """Return a square fence around the vehicle, 30 m wide."""
    here = place(check)
    kind = mavlink.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION
    corners = ((-1, -1), (1, -1), (1, 1), (-1, 1))
    return [
        PlanItem(kind, *moved(here, FENCE_M * north, FENCE_M * east), params=(4.0, 0.0, 0.0, 0.0))
        for north, east in corners
    ]


def same_places(first: list[PlanItem], second: list[PlanItem], skip: int = 0) -> bool:
    """Return True if two plans have equal commands, and equal positions to 2 cm."""
    near = 2
    return len(first) == len(second) and all(
        one.command == other.command
        and abs(one.x - other.x) <= near
        and abs(one.y - other.y) <= near
        for one, other in list(zip(first, second, strict=True))[skip:]
    )


HOLD: Final = mavlink.ROVER_MODE_HOLD
GUIDED: Final = mavlink.ROVER_MODE_GUIDED
AUTO: Final = mavlink.ROVER_MODE_AUTO
ARM: Final = mavlink.MAV_CMD_COMPONENT_ARM_DISARM
ACCEPTED: Final = mavlink.MAV_RESULT_ACCEPTED
MOVING_M: Final = 0.03
TURNING_RAD: Final = 0.05
STILL_M_S: Final = 0.02
NOISE_FACTOR: Final = 2
MAX_NOISE_M: Final = 1.0
MAX_NOISE_M_S: Final = 0.2
SEND_HZ: Final = 10
WAY_S: Final = 3.0


def stand(check: VehicleCheck) -> None:
    """Choose HOLD; disarm a vehicle that the judge may move. Only of a Rover it knows the modes."""
    if not check.is_rover:
        return
    if check.mode != HOLD:
        check.set_mode(HOLD)
        check.station.wait(1.0, lambda: check.mode == HOLD)
    if check.is_armed and check.options.allow_motion:
        check.main.result_of(ARM, 0)
        check.station.wait(1.0, lambda: not check.is_armed)


def start(check: VehicleCheck, mode: int, found: Findings) -> bool:
    """Choose a mode and arm; return False, with a fault, if that does not work."""
    since = check.main.mark()
    changed = check.set_mode(mode)
    result = check.main.result_of(ARM, 1, within_s=2.0)
    is_there = check.station.wait(2.0, lambda: check.is_armed and check.mode == mode)
    if is_there:
        return True
    names = f"mode {mode}: {result_name(changed)}, arm: {result_name(result)}"
    found.expect(False, f"{names} {check.texts(since)}")
    return False


def position(check: VehicleCheck) -> tuple[float, float]:
    """Return north and east of the newest LOCAL_POSITION_NED."""
    one = newest(check, "LOCAL_POSITION_NED")
    return float(one.x), float(one.y)


def speed(check: VehicleCheck) -> float:
    """Return the newest speed over ground."""
    one = newest(check, "LOCAL_POSITION_NED")
    return hypot(one.vx, one.vy)


def yaw(check: VehicleCheck) -> float:
    """Return the newest heading."""
    return float(newest(check, "ATTITUDE").yaw)


def newest(check: VehicleCheck, name: str) -> Any:
    """Return the newest message of a name, which a row has waited for before."""
    frame = check.main.latest(name)
    assert frame is not None
    return frame.message


def moving_m(check: VehicleCheck) -> float:
    """Return a way that a vehicle at rest does not seem to move, by the noise of its position."""
    if "noise" not in check.facts:
        places = [(one.message.x, one.message.y) for one in check.seen("LOCAL_POSITION_NED")]
        spans = [max(axis) - min(axis) for axis in zip(*places, strict=True)]
        speeds = [hypot(one.message.vx, one.message.vy) for one in check.seen("LOCAL_POSITION_NED")]
        check.facts["noise"] = max(spans, default=0.0), max(speeds, default=0.0)
    found: float = max(MOVING_M, min(NOISE_FACTOR * check.facts["noise"][0], MAX_NOISE_M))
    return found


def still_m_s(check: VehicleCheck) -> float:
    """Return a speed that a vehicle at rest may seem to have."""
    moving_m(check)
    found: float = max(STILL_M_S, min(NOISE_FACTOR * check.facts["noise"][1], MAX_NOISE_M_S))
    return found


def distance(check: VehicleCheck, start_at: tuple[float, float]) -> float:
    """Return the distance of the vehicle from a position."""
    now = position(check)
    return hypot(now[0] - start_at[0], now[1] - start_at[1])


def has_moved(check: VehicleCheck, start_at: tuple[float, float], within_s: float = 0.0) -> bool:
    """Return True if the vehicle has left a place, or leaves it in time."""
    return check.station.wait(within_s, lambda: distance(check, start_at) > moving_m(check))


def stream(
    check: VehicleCheck,
    message: Callable[[], MavMessage],
    seconds: float,
    until: Callable[[], bool] = lambda: False,
) -> bool:
    """Repeat a setpoint for some time, or until a condition is met."""
    for _ in range(round(seconds * SEND_HZ)):
        check.main.send(message())
        check.station.wait(1 / SEND_HZ)
        if until():
            return True
    return until()


def expect_rest(
    check: VehicleCheck, found: Findings, message: Callable[[], MavMessage], seconds: float
) -> None:
    """Repeat a setpoint in HOLD; expect the vehicle to stay."""
    here = position(check)
    stream(check, message, seconds)
    fact = f"in HOLD moved {distance(check, here):.3f} m"
    found.expect(not has_moved(check, here), fact)


def expect_way(
    check: VehicleCheck, found: Findings, message: Callable[[], MavMessage], words: str
) -> None:
    """Repeat a setpoint; expect the vehicle to move. A fault contains the vehicle's texts."""
    here, since = position(check), check.main.mark()
    is_moving = stream(check, message, WAY_S, lambda: has_moved(check, here))
    fact = f"{words} moved {distance(check, here):.2f} m"
    found.expect(is_moving, fact if is_moving else f"{fact} {check.texts(since)!r}")


def stops_within(check: VehicleCheck, seconds: float) -> bool:
    """Return True if the vehicle stops within some time."""
    return check.station.wait(seconds, lambda: speed(check) < still_m_s(check))


def expect_goto(check: VehicleCheck, found: Findings, reposition: Any) -> None:
    """Drive a step by DO_REPOSITION, in GUIDED."""
    if not start(check, GUIDED, found):
        return
    here, since = position(check), check.main.mark()
    at = moved(place(check), *ahead(check))
    message = reposition(check, at, as_int=True)
    number = mavlink.MAV_CMD_DO_REPOSITION
    ack = check.main.ask(message, "COMMAND_ACK", lambda one: one.command == number, 2.0)
    result = None if ack is None else int(ack.message.result)
    is_moving = has_moved(check, here, 5.0)
    fact = f"in GUIDED: {result_name(result)}, moved {distance(check, here):.2f} m"
    is_right = result == ACCEPTED and is_moving
    found.expect(is_right, fact if is_right else f"{fact} {check.texts(since)!r}")
    stand(check)


def ahead(check: VehicleCheck) -> tuple[float, float]:
    """Return a step north and east along the vehicle's heading."""
    heading, step = yaw(check), step_m(check)
    return step * cos(heading), step * sin(heading)


def expect_mission(check: VehicleCheck, found: Findings, *, by_command: bool) -> None:
    """Start the mission by MISSION_START or by the mode; expect it to run, and HOLD to stop it."""
    if not start(check, GUIDED, found):
        return
    here, since = position(check), check.main.mark()
    if by_command:
        result = check.main.result_of(mavlink.MAV_CMD_MISSION_START, within_s=2.0)
    else:
        result = check.set_mode(AUTO)
    is_auto = check.station.wait(2.0, lambda: check.mode == AUTO)
    is_moving = has_moved(check, here, 5.0)
    fact = f"start: {result_name(result)}, mode {check.mode}, moved {distance(check, here):.2f} m"
    is_right = result == ACCEPTED and is_auto and is_moving
    found.expect(is_right, fact if is_right else f"{fact} {check.texts(since)!r}")
    stand(check)
