"""Rows 2, 38, 44-47: states, and driving by setpoints and by hand; only with --allow-motion."""

from collections.abc import Callable
from functools import wraps
from math import pi
from typing import Final

from vehicle_check import row_steps
from vehicle_check.ground_stations import result_name
from vehicle_check.mavlink_frames import MavMessage, mavlink
from vehicle_check.row_steps import send_plan, small_mission, step_m
from vehicle_check.vehicle_under_test import (
    ROVER,
    Findings,
    Judge,
    RowVerdict,
    VehicleCheck,
    failed,
    is_vehicle,
    not_tried,
    row,
)

HOLD: Final = mavlink.ROVER_MODE_HOLD
MANUAL: Final = mavlink.ROVER_MODE_MANUAL
INITIALISING: Final = mavlink.ROVER_MODE_INITIALIZING
TROUBLED: Final = (
    mavlink.MAV_STATE_CRITICAL, mavlink.MAV_STATE_EMERGENCY, mavlink.MAV_STATE_FLIGHT_TERMINATION,
)  # fmt: skip
TERMINATE: Final = mavlink.MAV_CMD_DO_FLIGHTTERMINATION
ONLY_VELOCITY: Final = 0b0000_1101_1100_0111
"""Type mask of SET_POSITION_TARGET: velocity is used, yaw, position and acceleration are not."""
WITH_ACCELERATION: Final = 0b0000_1100_0011_1111
IGNORE_QUATERNION: Final = mavlink.ATTITUDE_TARGET_TYPEMASK_ATTITUDE_IGNORE
FRAMES: Final = (1, 7, 8, 9)
STOP_S: Final = 1.8
MANUAL_STOP_S: Final = 1.2
NEEDED: Final = "needs --allow-motion"


def with_motion(judge: Judge) -> Judge:
    """Judge a row only if the vehicle may be moved; stop it at the end."""

    @wraps(judge)
    def judged(check: VehicleCheck) -> RowVerdict:
        if not check.options.allow_motion:
            return not_tried(NEEDED)
        for name in ("LOCAL_POSITION_NED", "ATTITUDE"):
            if not check.main.sent(name) and check.main.expect_sent(name, 1.0) is None:
                return failed(f"no {name}: cannot tell whether it moves")
        row_steps.stand(check)
        try:
            return judge(check)
        finally:
            row_steps.stand(check)

    return judged


@row(
    2,
    "system_status: HOLD is STANDBY, other modes ACTIVE, e-stop EMERGENCY",
    suffers="QGroundControl: 'flying' decides what mission start sends",
    source="ArduPilot Rover/GCS_MAVLink_Rover.cpp",
    profiles=ROVER,
)
def states(check: VehicleCheck) -> RowVerdict:
    """Judge all heartbeats so far; with motion, stop in an emergency and clear it."""
    found, wrong, seen = Findings(), set(), set()
    frames = check.main.sent("HEARTBEAT", where=is_vehicle)
    for one in (frame.message for frame in frames):
        if one.custom_mode == INITIALISING or one.system_status in TROUBLED:
            continue
        is_hold = one.custom_mode == HOLD
        wanted = mavlink.MAV_STATE_STANDBY if is_hold else mavlink.MAV_STATE_ACTIVE
        seen.add((one.custom_mode, one.system_status))
        if one.system_status != wanted:
            wrong.add((one.custom_mode, one.system_status))
    found.expect(not wrong, f"(mode, state) {sorted(wrong or seen)}")
    if check.options.allow_motion:
        _expect_emergency(check, found)
    return found.verdict()


def _expect_emergency(check: VehicleCheck, found: Findings) -> None:
    row_steps.stand(check)
    emergency = mavlink.MAV_STATE_EMERGENCY
    other = check.second if check.serves_two else check.main
    result = other.result_of(TERMINATE, 1, within_s=2.0)
    beat = check.main.expect_sent("HEARTBEAT", 2.0, lambda one: one.system_status == emergency)
    fact = f"185 of another client: {result_name(result)}"
    found.expect(result == mavlink.MAV_RESULT_ACCEPTED and beat, f"{fact}, EMERGENCY {bool(beat)}")
    cleared = check.main.result_of(TERMINATE, 0, within_s=2.0)
    back = check.main.expect_sent("HEARTBEAT", 2.0, lambda one: one.system_status != emergency)
    found.expect(back, f"185 with 0: {result_name(cleared)}")


@row(
    38,
    "mode AUTO starts or continues the mission; leaving AUTO pauses it",
    suffers="QGroundControl sends only the mode while 'flying'",
    source="QGroundControl src/FirmwarePlugin/APM/APMFirmwarePlugin.cc",
    profiles=ROVER,
)
@with_motion
def auto(check: VehicleCheck) -> RowVerdict:
    """Start the mission by the mode, and leave it."""
    found = Findings()
    send_plan(check, small_mission(check, spread_m=max(1.0, step_m(check))))
    row_steps.expect_mission(check, found, by_command=False)
    found.expect(row_steps.stops_within(check, 2.0), f"in HOLD {row_steps.speed(check):.2f} m/s")
    return found.verdict()


def velocity(
    check: VehicleCheck, speed_m_s: float, mask: int = ONLY_VELOCITY, frame: int = 8
) -> MavMessage:
    """Return SET_POSITION_TARGET_LOCAL_NED with a velocity, by default ahead."""
    target = check.station.address
    return mavlink.MAVLink_set_position_target_local_ned_message(
        0, *target, frame, mask, 0, 0, 0, speed_m_s, 0, 0, 0, 0, 0, 0, 0
    )


@row(
    44,
    "SET_POSITION_TARGET: only in GUIDED, frames 1, 7, 8, 9, stops 1 s after the last",
    suffers="MAVSDK offboard, mavros setpoint_raw",
    source="ArduPilot Rover/GCS_MAVLink_Rover.cpp; MAVSDK offboard plugin; mavros setpoint_raw",
    profiles=ROVER,
)
@with_motion
def setpoints(check: VehicleCheck) -> RowVerdict:
    """Send velocities in HOLD and in GUIDED."""
    found = Findings()
    row_steps.expect_rest(check, found, lambda: velocity(check, 0.2), 1.0)
    if not row_steps.start(check, row_steps.GUIDED, found):
        return found.verdict()
    row_steps.expect_way(check, found, lambda: velocity(check, 0.2), "in GUIDED")
    found.expect(row_steps.stops_within(check, STOP_S), f"then {row_steps.speed(check):.2f} m/s")
    since = check.main.mark()
    for frame in FRAMES:
        check.main.send_surely(velocity(check, 0.0, frame=frame))
    check.station.wait(0.5)
    text = check.texts(since)
    found.expect("rame" not in text, f"frames {FRAMES}: {text!r}")
    _expect_acceleration(check, found)
    return found.verdict()


def _expect_acceleration(check: VehicleCheck, found: Findings) -> None:
    since = check.main.mark()
    target = check.station.address
    message = mavlink.MAVLink_set_position_target_local_ned_message(
        0, *target, 8, WITH_ACCELERATION, 0, 0, 0, 0, 0, 0, 0.1, 0, 0, 0, 0
    )
    row_steps.stream(check, lambda: message, 0.5)
    check.main.expect_sent("STATUSTEXT", 1.0, since=since)
    text = check.texts(since)
    found.expect(text, f"acceleration: text {text!r}")


@row(
    45,
    "SET_ATTITUDE_TARGET: thrust is speed, body_yaw_rate is turn; 213 and 194 answered",
    suffers="mavros, ArduPilot scripts",
    source="ArduPilot Rover/GCS_MAVLink_Rover.cpp; mavros",
    profiles=ROVER,
)
@with_motion
def attitude_target(check: VehicleCheck) -> RowVerdict:
    """Drive by thrust."""
    found = Findings()
    if not row_steps.start(check, row_steps.GUIDED, found):
        return found.verdict()
    target = check.station.address
    message = mavlink.MAVLink_set_attitude_target_message(
        0, *target, IGNORE_QUATERNION, [1, 0, 0, 0], 0, 0, 0, 0.3
    )
    row_steps.expect_way(check, found, lambda: message, "thrust 0.3")
    for number in (mavlink.MAV_CMD_NAV_SET_YAW_SPEED, mavlink.MAV_CMD_DO_SET_REVERSE):
        result = check.main.result_of(number, 0)
        is_right = result not in (None, mavlink.MAV_RESULT_UNSUPPORTED)
        found.expect(is_right, f"{number}: {result_name(result)}")
    return found.verdict()


@row(
    46,
    "MANUAL_CONTROL: y steers, z drives, only in MANUAL, stops after the last",
    suffers="QGroundControl and MAVSDK joysticks",
    source="ArduPilot Rover/GCS_MAVLink_Rover.cpp; QGroundControl; MAVSDK",
    profiles=ROVER,
)
@with_motion
def manual_control(check: VehicleCheck) -> RowVerdict:
    """Drive and turn by hand."""

    def sticks(y: int, z: int) -> MavMessage:
        return mavlink.MAVLink_manual_control_message(check.target, 0, y, z, 0, 0)

    return _by_hand(check, lambda: sticks(0, 400), lambda: sticks(600, 0))


@row(
    47,
    "RC_CHANNELS_OVERRIDE: 1 steers, 3 drives, 0 releases; RC_CHANNELS echoes",
    suffers="MAVProxy rc, DroneKit overrides, Mission Planner joystick",
    source="MAVProxy rc; DroneKit; Mission Planner",
    profiles=ROVER,
)
@with_motion
def overrides(check: VehicleCheck) -> RowVerdict:
    """Drive and turn by channels."""

    def channels(steer: int, drive: int) -> MavMessage:
        target = check.station.address
        ignored = 65_535
        return mavlink.MAVLink_rc_channels_override_message(
            *target, steer, ignored, drive, *[ignored] * 5
        )

    since = check.main.mark()
    verdict = _by_hand(check, lambda: channels(1500, 1700), lambda: channels(1800, 1500))
    check.main.send_surely(channels(0, 0))
    echoes = check.main.sent("RC_CHANNELS", since, lambda one: one.chan3_raw == 1700)
    found = Findings()
    found.expect(verdict.status == "pass", verdict.evidence)
    found.expect(echoes, f"RC_CHANNELS with 1700: {len(echoes)}")
    return found.verdict()


def _by_hand(
    check: VehicleCheck, ahead: Callable[[], MavMessage], turn: Callable[[], MavMessage]
) -> RowVerdict:
    found = Findings()
    row_steps.expect_rest(check, found, ahead, 0.8)
    if not row_steps.start(check, MANUAL, found):
        return found.verdict()
    row_steps.expect_way(check, found, ahead, "in MANUAL")
    is_still = row_steps.stops_within(check, MANUAL_STOP_S)
    found.expect(is_still, f"after the last {row_steps.speed(check):.2f} m/s")
    before = row_steps.yaw(check)

    def turned() -> float:
        return (row_steps.yaw(check) - before + pi) % (2 * pi) - pi

    row_steps.stream(check, turn, 2.0, lambda: turned() > row_steps.TURNING_RAD)
    found.expect(turned() > row_steps.TURNING_RAD, f"turned {turned():.2f} rad clockwise")
    return found.verdict()
