"""Functions that rows with motion share: arm in a mode, measure motion, stop."""

from collections.abc import Callable
from math import hypot
from typing import Any, Final

from ground.vehicle_check.check import Check
from ground.vehicle_check.dialect import MavMessage, mavlink
from ground.vehicle_check.plans import moved, place
from ground.vehicle_check.session import result_name
from ground.vehicle_check.verdict import Findings

HOLD: Final = mavlink.ROVER_MODE_HOLD
GUIDED: Final = mavlink.ROVER_MODE_GUIDED
AUTO: Final = mavlink.ROVER_MODE_AUTO
ARM: Final = mavlink.MAV_CMD_COMPONENT_ARM_DISARM
ACCEPTED: Final = mavlink.MAV_RESULT_ACCEPTED
MOVING_M: Final = 0.03
TURNING_RAD: Final = 0.05
STILL_M_S: Final = 0.02
SEND_HZ: Final = 10
STEP_M: Final = 0.4


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
    frames = check.main.heard("LOCAL_POSITION_NED")
    one = frames[-1].message
    return float(one.x), float(one.y)


def speed(check: Check) -> float:
    """Return the newest speed over ground."""
    frames = check.main.heard("LOCAL_POSITION_NED")
    one = frames[-1].message
    return hypot(one.vx, one.vy)


def yaw(check: Check) -> float:
    """Return the newest heading."""
    frames = check.main.heard("ATTITUDE")
    return float(frames[-1].message.yaw)


def distance(check: Check, start_at: tuple[float, float]) -> float:
    """Return the distance of the vehicle from a position."""
    now = position(check)
    return hypot(now[0] - start_at[0], now[1] - start_at[1])


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


def stops_within(check: Check, seconds: float) -> bool:
    """Return True if the vehicle stops within some time."""
    return check.station.wait(seconds, lambda: speed(check) < STILL_M_S)


def expect_goto(check: Check, found: Findings, reposition: Any) -> None:
    """Drive a step by DO_REPOSITION, in GUIDED."""
    if not start(check, GUIDED, found):
        return
    here = position(check)
    at = moved(place(check), *ahead(check))
    message = reposition(check, at, as_int=True)
    number = mavlink.MAV_CMD_DO_REPOSITION
    ack = check.main.ask(message, "COMMAND_ACK", lambda one: one.command == number, 2.0)
    result = None if ack is None else int(ack.message.result)
    is_moving = check.station.wait(5.0, lambda: distance(check, here) > MOVING_M)
    fact = f"in GUIDED: {result_name(result)}, moved {distance(check, here):.2f} m"
    found.expect(result == ACCEPTED and is_moving, fact)
    stand(check)


def ahead(check: Check) -> tuple[float, float]:
    """Return a step north and east along the vehicle's heading."""
    from math import cos, sin

    heading = yaw(check)
    return STEP_M * cos(heading), STEP_M * sin(heading)


def expect_mission(check: Check, found: Findings, *, by_command: bool) -> None:
    """Start the mission by MISSION_START or by the mode; expect it to run, and HOLD to stop it."""
    if not start(check, GUIDED, found):
        return
    here = position(check)
    if by_command:
        result = check.main.result_of(mavlink.MAV_CMD_MISSION_START, within_s=2.0)
    else:
        result = check.set_mode(AUTO)
    is_auto = check.station.wait(2.0, lambda: check.mode == AUTO)
    is_moving = check.station.wait(5.0, lambda: distance(check, here) > MOVING_M)
    fact = f"start: {result_name(result)}, mode {check.mode}, moved {distance(check, here):.2f} m"
    found.expect(result == ACCEPTED and is_auto and is_moving, fact)
    stand(check)
