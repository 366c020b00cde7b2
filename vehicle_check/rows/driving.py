"""Functions that rows with motion share: arm in a mode, measure motion, stop."""

from collections.abc import Callable
from math import cos, hypot, sin
from typing import Any, Final

from vehicle_check.check import Check
from vehicle_check.dialect import MavMessage, mavlink
from vehicle_check.plans import moved, place, step_m
from vehicle_check.session import result_name
from vehicle_check.verdict import Findings

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


def stand(check: Check) -> None:
    """Choose HOLD; disarm a vehicle that the judge may move."""
    if check.mode != HOLD:
        check.set_mode(HOLD)
        check.station.wait(1.0, lambda: check.mode == HOLD)
    if check.is_armed and check.options.allow_motion:
        check.main.result_of(ARM, 0)
        check.station.wait(1.0, lambda: not check.is_armed)


def start(check: Check, mode: int, found: Findings) -> bool:
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


def position(check: Check) -> tuple[float, float]:
    """Return north and east of the newest LOCAL_POSITION_NED."""
    one = newest(check, "LOCAL_POSITION_NED")
    return float(one.x), float(one.y)


def speed(check: Check) -> float:
    """Return the newest speed over ground."""
    one = newest(check, "LOCAL_POSITION_NED")
    return hypot(one.vx, one.vy)


def yaw(check: Check) -> float:
    """Return the newest heading."""
    return float(newest(check, "ATTITUDE").yaw)


def newest(check: Check, name: str) -> Any:
    """Return the newest message of a name, which a row has waited for before."""
    frame = check.main.latest(name)
    assert frame is not None
    return frame.message


def moving_m(check: Check) -> float:
    """Return a way that a vehicle at rest does not seem to move, by the noise of its position."""
    if "noise" not in check.facts:
        places = [(one.message.x, one.message.y) for one in check.seen("LOCAL_POSITION_NED")]
        spans = [max(axis) - min(axis) for axis in zip(*places, strict=True)]
        speeds = [hypot(one.message.vx, one.message.vy) for one in check.seen("LOCAL_POSITION_NED")]
        check.facts["noise"] = max(spans, default=0.0), max(speeds, default=0.0)
    found: float = max(MOVING_M, min(NOISE_FACTOR * check.facts["noise"][0], MAX_NOISE_M))
    return found


def still_m_s(check: Check) -> float:
    """Return a speed that a vehicle at rest may seem to have."""
    moving_m(check)
    found: float = max(STILL_M_S, min(NOISE_FACTOR * check.facts["noise"][1], MAX_NOISE_M_S))
    return found


def distance(check: Check, start_at: tuple[float, float]) -> float:
    """Return the distance of the vehicle from a position."""
    now = position(check)
    return hypot(now[0] - start_at[0], now[1] - start_at[1])


def has_moved(check: Check, start_at: tuple[float, float], within_s: float = 0.0) -> bool:
    """Return True if the vehicle has left a place, or leaves it in time."""
    return check.station.wait(within_s, lambda: distance(check, start_at) > moving_m(check))


def stream(
    check: Check,
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
    check: Check, found: Findings, message: Callable[[], MavMessage], seconds: float
) -> None:
    """Repeat a setpoint in HOLD; expect the vehicle to stay."""
    here = position(check)
    stream(check, message, seconds)
    fact = f"in HOLD moved {distance(check, here):.3f} m"
    found.expect(not has_moved(check, here), fact)


def expect_way(
    check: Check, found: Findings, message: Callable[[], MavMessage], words: str
) -> None:
    """Repeat a setpoint; expect the vehicle to move. A fault contains the vehicle's texts."""
    here, since = position(check), check.main.mark()
    is_moving = stream(check, message, WAY_S, lambda: has_moved(check, here))
    fact = f"{words} moved {distance(check, here):.2f} m"
    found.expect(is_moving, fact if is_moving else f"{fact} {check.texts(since)!r}")


def stops_within(check: Check, seconds: float) -> bool:
    """Return True if the vehicle stops within some time."""
    return check.station.wait(seconds, lambda: speed(check) < still_m_s(check))


def expect_goto(check: Check, found: Findings, reposition: Any) -> None:
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


def ahead(check: Check) -> tuple[float, float]:
    """Return a step north and east along the vehicle's heading."""
    heading, step = yaw(check), step_m(check)
    return step * cos(heading), step * sin(heading)


def expect_mission(check: Check, found: Findings, *, by_command: bool) -> None:
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
