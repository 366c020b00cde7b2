"""Rows 2, 38, 44-47, 63, 65, 69, 71: states, and driving by setpoints, by hand and to goals."""

from collections.abc import Callable
from functools import wraps
from math import cos, hypot, pi, sin
from typing import Final

from runtime.units import NS_PER_S
from vehicle_check import row_steps
from vehicle_check.ground_stations import result_name
from vehicle_check.mavlink_frames import NUMBERS, MavMessage, mavlink
from vehicle_check.row_steps import send_plan, small_mission, step_m
from vehicle_check.rows.command_rows import answer_to, reposition, standing
from vehicle_check.transfers import download_parameters, read_parameter, write
from vehicle_check.vehicle_under_test import (
    ROVER,
    SET_MESSAGE_INTERVAL,
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
STOP_S: Final = 0.8
TIMEOUT: Final = "GUID_TIMEOUT"
MAX_TIMEOUT_S: Final = 3.0
"""ArduPilot's own, and the longest that a rover may drive on without a setpoint."""
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
    "SET_POSITION_TARGET: only in GUIDED, frames 1, 7, 8, 9, stops by its time-out",
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
    stop_s = timeout_s(check) + STOP_S
    is_still = row_steps.stops_within(check, stop_s)
    found.expect(is_still, f"{row_steps.speed(check):.2f} m/s after {stop_s:.1f} s")
    since = check.main.mark()
    for frame in FRAMES:
        check.main.send_surely(velocity(check, 0.0, frame=frame))
    check.station.wait(0.5)
    text = check.texts(since)
    found.expect("rame" not in text, f"frames {FRAMES}: {text!r}")
    _expect_acceleration(check, found)
    return found.verdict()


def timeout_s(check: VehicleCheck) -> float:
    """Return after how long without a setpoint the vehicle stops, if it says so."""
    one = read_parameter(check.main, TIMEOUT)
    return MAX_TIMEOUT_S if one is None else min(MAX_TIMEOUT_S, float(one.param_value))


POSITION_MASKS: Final = (2040, 3580, 3064)
"""Of MavKit, MAVProxy and mavros: force and yaw rate are not masked, altitude is, yaw is not."""


@row(
    63,
    "SET_POSITION_TARGET drives to a position with the masks of common clients",
    suffers="MavKit, MAVProxy, mavros: a valid position is refused",
    source="ArduPilot Rover/GCS_MAVLink_Rover.cpp",
    profiles=ROVER,
)
@with_motion
def position_masks(check: VehicleCheck) -> RowVerdict:
    """Send a position ahead with each mask."""
    found, target = Findings(), check.station.address
    for mask in POSITION_MASKS:
        row_steps.stand(check)
        if not row_steps.start(check, row_steps.GUIDED, found):
            return found.verdict()
        here, step = row_steps.position(check), row_steps.ahead(check)
        message = mavlink.MAVLink_set_position_target_local_ned_message(
            0, *target, mavlink.MAV_FRAME_LOCAL_NED, mask, here[0] + step[0], here[1] + step[1],
            *[0.0] * 7, row_steps.yaw(check), 0.0,
        )  # fmt: skip
        row_steps.expect_way(check, found, lambda: message, f"mask {mask}")  # noqa: B023
    return found.verdict()


ODD_SPEED_M_S: Final = 0.137
FAR_M: Final = 2.0
DRIVE_S: Final = 2.5
KEPT_SPEED: Final = 0.8


@row(
    65,
    "a speed of 178 or of DO_REPOSITION ends with the mode, and changes no parameter",
    suffers="every client: missions and sticks stay slow after one slow goal",
    source="ArduPilot Rover/mode.cpp, GCS_MAVLink_Rover.cpp",
    profiles=ROVER,
)
@standing
def lapsing_speed(check: VehicleCheck) -> RowVerdict:
    """Order an odd speed in GUIDED, and look for it in the parameters; with motion, drive after."""
    found = Findings()
    before = download_parameters(check.main).values
    may_drive = check.options.allow_motion
    usual = _top_speed(check, found) if may_drive else 0.0
    if not check.is_armed and check.set_mode(row_steps.GUIDED) == mavlink.MAV_RESULT_ACCEPTED:
        order = mavlink.MAV_CMD_DO_CHANGE_SPEED
        ordered = check.main.result_of(order, 1, ODD_SPEED_M_S, -1)
        message = reposition(check, row_steps.place(check), as_int=True, speed=ODD_SPEED_M_S)
        answer_to(check, message, mavlink.MAV_CMD_DO_REPOSITION)
        found.fact(f"178 in GUIDED: {result_name(ordered)}")
    row_steps.stand(check)
    after = download_parameters(check.main).values
    odd = [
        f"{name} {before[name].value:g} -> {one.value:g}"
        for name, one in after.items()
        if name in before and before[name].value != one.value and _is_odd_speed(one.value)
    ]
    found.expect(not odd, f"parameters changed: {odd}")
    found.expect(after, f"{len(after)} parameters")
    if usual:
        again = _top_speed(check, found)
        fact = f"{again:.2f} m/s after an order of {ODD_SPEED_M_S}, {usual:.2f} m/s before"
        found.expect(again >= usual * KEPT_SPEED, fact)
    return found.verdict()


def _is_odd_speed(value: float) -> bool:
    """Return True for the odd speed in m/s or cm/s."""
    return any(abs(value - scale * ODD_SPEED_M_S) < 0.01 * scale for scale in (1.0, 100.0))


def _top_speed(check: VehicleCheck, found: Findings) -> float:
    """Drive at a place ahead for some time, and stop; return the greatest speed."""
    if not row_steps.start(check, row_steps.GUIDED, found):
        return 0.0
    heading, since = row_steps.yaw(check), check.main.mark()
    far_m = max(FAR_M, 2 * step_m(check))
    way = (far_m * cos(heading), far_m * sin(heading))
    message = reposition(check, row_steps.moved(row_steps.place(check), *way), as_int=True)
    answer_to(check, message, mavlink.MAV_CMD_DO_REPOSITION)
    check.station.wait(DRIVE_S)
    row_steps.stand(check)
    frames = check.main.sent("LOCAL_POSITION_NED", since)
    return max((hypot(one.message.vx, one.message.vy) for one in frames), default=0.0)


SECONDS: Final = 10
SLOW_M_S: Final = 0.15
STARTED_S: Final = 1.5


@row(
    69,
    "velocities once a second, of which every third is lost, drive for 10 s without a stop",
    suffers="MAVSDK offboard, mavros and scripts on a radio: the vehicle stutters",
    source="ArduPilot Rover/mode_guided.cpp, GUID_TIMEOUT",
    profiles=ROVER,
)
@with_motion
def slow_setpoints(check: VehicleCheck) -> RowVerdict:
    """Send them; first lengthen a time-out that is a parameter to ArduPilot's 3 s."""
    found = Findings()
    own = read_parameter(check.main, TIMEOUT)
    is_short = own is not None and own.param_value < MAX_TIMEOUT_S
    if is_short:
        write(check.main, TIMEOUT, MAX_TIMEOUT_S, own.param_type)
        found.fact(f"{TIMEOUT} {own.param_value:g} s, for this row {MAX_TIMEOUT_S:g} s")
    try:
        _expect_no_rest(check, found)
    finally:
        row_steps.stand(check)
        if is_short:
            write(check.main, TIMEOUT, own.param_value, own.param_type)
    return found.verdict()


def _expect_no_rest(check: VehicleCheck, found: Findings) -> None:
    if not row_steps.start(check, row_steps.GUIDED, found):
        return
    here, since_ns = row_steps.position(check), check.station.now_ns + round(STARTED_S * NS_PER_S)
    for number in range(SECONDS):
        if number % 3 != 2:
            check.main.send_surely(velocity(check, SLOW_M_S))
        check.station.wait(1.0)
    frames = [one for one in check.main.sent("LOCAL_POSITION_NED") if one.at_ns >= since_ns]
    still = row_steps.still_m_s(check)
    rests = sum(hypot(one.message.vx, one.message.vy) < still for one in frames)
    fact = (
        f"{rests} of {len(frames)} samples at rest, moved {row_steps.distance(check, here):.2f} m"
    )
    found.expect(frames and not rests, fact)


GOAL_MESSAGES: Final = ("NAV_CONTROLLER_OUTPUT", "POSITION_TARGET_GLOBAL_INT")
NEAR_E7: Final = 20
ARRIVE_S: Final = 30.0
TWICE_A_SECOND_US: Final = 500_000


@row(
    71,
    "while a goal is set: NAV_CONTROLLER_OUTPUT, POSITION_TARGET_GLOBAL_INT; then ITEM_REACHED 0",
    suffers="MavKit, MAVProxy, Mission Planner: no distance to the goal, no arrival",
    source="ArduPilot Rover/GCS_MAVLink_Rover.cpp, mode_guided.cpp",
    profiles=ROVER,
)
@with_motion
def goal_messages(check: VehicleCheck) -> RowVerdict:
    """Drive a step in GUIDED, and wait for the arrival."""
    found = Findings()
    for name in GOAL_MESSAGES:
        check.main.result_of(SET_MESSAGE_INTERVAL, NUMBERS[name], TWICE_A_SECOND_US)
    if not row_steps.start(check, row_steps.GUIDED, found):
        return found.verdict()
    goal = row_steps.moved(row_steps.place(check), *row_steps.ahead(check))
    since = check.main.mark()
    result = answer_to(check, reposition(check, goal, as_int=True), mavlink.MAV_CMD_DO_REPOSITION)
    found.expect(result == mavlink.MAV_RESULT_ACCEPTED, f"goal: {result_name(result)}")
    for name in GOAL_MESSAGES:
        one = check.main.expect_sent(name, 2.0, since=since)
        found.expect(one, f"{name}: {'sent' if one else 'not sent'}")
    target = check.main.latest("POSITION_TARGET_GLOBAL_INT")
    if target is not None:
        apart = target.message.lat_int - goal[0], target.message.lon_int - goal[1]
        found.expect(max(map(abs, apart)) <= NEAR_E7, f"target {apart} e-7 degrees from the goal")
    arrived = check.main.expect_sent(
        "MISSION_ITEM_REACHED", ARRIVE_S, lambda one: one.seq == 0, since
    )
    found.expect(arrived, f"MISSION_ITEM_REACHED 0: {'sent' if arrived else 'not sent'}")
    for name in GOAL_MESSAGES:
        check.main.result_of(SET_MESSAGE_INTERVAL, NUMBERS[name], 0)
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
