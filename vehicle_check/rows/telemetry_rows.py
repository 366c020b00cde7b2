"""Rows 7, 8, 11-18, 25, 26, 48: streams and their rates, sonars, and messages on request.

The sonars are OBSTACLE_DISTANCE, DISTANCE_SENSOR and RANGEFINDER; on request are origin, modes and
clocks.
"""

from functools import partial
from math import isfinite, pi
from typing import Any, Final

from runtime.units import NS_PER_S
from vehicle_check import row_steps
from vehicle_check.ground_stations import COMPONENT, GroundStation, result_name
from vehicle_check.mavlink_frames import NUMBERS, TIMESYNC, ExtraMessage, mavlink
from vehicle_check.vehicle_under_test import (
    ARDUPILOTS,
    ONE_CLIENT,
    SET_MESSAGE_INTERVAL,
    Findings,
    RowStatus,
    RowVerdict,
    VehicleCheck,
    failed,
    not_applicable,
    row,
)

PREARM: Final = mavlink.MAV_SYS_STATUS_PREARM_CHECK
GEOFENCE: Final = mavlink.MAV_SYS_STATUS_GEOFENCE
PROXIMITY: Final = mavlink.MAV_SYS_STATUS_SENSOR_PROXIMITY
MIN_SATELLITES: Final = 6
NEAR_MM: Final = 20_000
"""The altitude of a rover above its home; a GPS alone is some metres off."""
GROUPS: Final = (1, 2, 3, 6, 10, 11, 12)
WATCH_S: Final = 2.0
KEPT: Final = 0.8
GROUP_MESSAGES: Final = ("SYS_STATUS", "GLOBAL_POSITION_INT", "ATTITUDE", "VFR_HUD")
"""One message of each of the groups 2, 6, 10 and 11, which ArduPilot's Rover has there."""


def rated(check: VehicleCheck, name: str, low_hz: float, high_hz: float) -> tuple[Findings, Any]:
    """Judge the rate of a message; return its newest one, too, None if there is none."""
    found = Findings()
    check.expect_rate(found, name, low_hz, high_hz)
    return found, check.newest(name)


@row(
    7,
    "SYS_STATUS 1-2 Hz with the bits PREARM, GEOFENCE and PROXIMITY",
    suffers="MAVSDK health, MAVProxy fence, QGroundControl",
    source="MAVSDK telemetry plugin; MAVProxy fence module",
)
def system_status(check: VehicleCheck) -> RowVerdict:
    """Judge rate and present bits."""
    found, one = rated(check, "SYS_STATUS", 1, 2)
    if one is not None:
        bits = one.onboard_control_sensors_present
        for name, bit in (("PREARM", PREARM), ("GEOFENCE", GEOFENCE), ("PROXIMITY", PROXIMITY)):
            is_absent = bit == PROXIMITY and not check.seen("OBSTACLE_DISTANCE")
            fact = f"{name} {'present' if bits & bit else 'not present'}"
            found.expect(bits & bit or is_absent or not check.is_ardupilot, fact)
    return found.verdict()


@row(
    8,
    "EKF_STATUS_REPORT 1 Hz: absolute position, variances of its own",
    suffers="DroneKit is_armable and ekf_ok; Mission Planner's EKF light",
    source="DroneKit is_armable; Mission Planner",
    profiles=ARDUPILOTS,
)
def ekf_status(check: VehicleCheck) -> RowVerdict:
    """Judge rate, flags and variances."""
    found, one = rated(check, "EKF_STATUS_REPORT", 1, 1)
    if one is None:
        return found.verdict()
    wanted = mavlink.EKF_POS_HORIZ_ABS | mavlink.EKF_PRED_POS_HORIZ_ABS
    is_right = one.flags & wanted == wanted and not one.flags & mavlink.EKF_CONST_POS_MODE
    found.expect(is_right, f"flags 0x{one.flags:x}")
    variances = (one.pos_horiz_variance, one.compass_variance, one.velocity_variance)
    is_real = all(isfinite(value) and value >= 0 for value in variances)
    found.expect(is_real and one.pos_horiz_variance > 0, f"variances {_numbers(variances)}")
    return found.verdict()


@row(
    11,
    "GLOBAL_POSITION_INT 5-10 Hz, relative_alt near 0, never 0/0",
    suffers="QGroundControl's goto needs the relative altitude; MAVSDK position",
    source="QGroundControl; MAVSDK telemetry plugin",
)
def global_position(check: VehicleCheck) -> RowVerdict:
    """Judge rate and fields."""
    found = Findings()
    check.expect_rate(found, "GLOBAL_POSITION_INT", 5, 10)
    frames = check.seen("GLOBAL_POSITION_INT")
    if frames:
        one = frames[-1].message
        at_zero = sum(frame.message.lat == 0 and frame.message.lon == 0 for frame in frames)
        found.expect(not at_zero, f"{at_zero} of {len(frames)} at 0/0")
        found.expect(abs(one.relative_alt) <= NEAR_MM, f"relative_alt {one.relative_alt} mm")
        found.fact(f"lat {one.lat} lon {one.lon}")
    return found.verdict()


@row(
    12,
    "GPS_RAW_INT 1 Hz, fix 3, satellites",
    suffers="DroneKit: wait_ready blocks without it; mavros",
    source="DroneKit wait_ready; mavros",
)
def gps(check: VehicleCheck) -> RowVerdict:
    """Judge rate and fix."""
    found, one = rated(check, "GPS_RAW_INT", 1, 5)
    if one is not None:
        found.expect(one.fix_type >= 3, f"fix_type {one.fix_type}")
        count = one.satellites_visible
        found.expect(MIN_SATELLITES <= count < 255, f"satellites {count}")
    return found.verdict()


@row(
    13,
    "LOCAL_POSITION_NED and ATTITUDE 10 Hz, VFR_HUD 2 Hz, covariance and ODOMETRY 5 Hz",
    suffers="MAVSDK offboard, DroneKit speed, mavros",
    source="MAVSDK offboard plugin; mavros",
)
def local_position(check: VehicleCheck) -> RowVerdict:
    """Judge the rates; the last two are extras, which a vehicle may refuse."""
    found = Findings()
    for name, rate_hz in (("LOCAL_POSITION_NED", 10), ("ATTITUDE", 10), ("VFR_HUD", 2)):
        check.expect_rate(found, name, rate_hz, rate_hz)
    for name in ("LOCAL_POSITION_NED_COV", "ODOMETRY"):
        refusal = (
            None if check.seen(name) else check.refusal_of(SET_MESSAGE_INTERVAL, NUMBERS[name])
        )
        if refusal:
            found.absent(f"no {name}: {refusal}")
        else:
            check.expect_rate(found, name, 5, 5)
    return found.verdict()


@row(
    18,
    "HOME_POSITION and BATTERY_STATUS at 0.5 Hz or more",
    suffers="QGroundControl: asks for all streams again after 10 s",
    source="QGroundControl src/FirmwarePlugin/APM/APMFirmwarePlugin.cc",
    profiles=ARDUPILOTS,
)
def home_and_battery(check: VehicleCheck) -> RowVerdict:
    """Judge the rates."""
    found = Findings()
    for name in ("HOME_POSITION", "BATTERY_STATUS"):
        check.expect_rate(found, name, 0.5, 10)
    return found.verdict()


@row(
    26,
    "REQUEST_DATA_STREAM and SET_MESSAGE_INTERVAL act, for one client only",
    suffers="QGroundControl, Mission Planner, MAVProxy, mavros: wrong rates",
    source="ArduPilot GCS_MAVLink/GCS_Common.cpp; QGroundControl APMFirmwarePlugin.cc",
    profiles=ARDUPILOTS,
)
def rates(check: VehicleCheck) -> RowVerdict:
    """Stop and start the groups of one client, change one message; the main client stays."""
    found = Findings()
    if not check.serves_two:
        return not_applicable(ONE_CLIENT)
    client = check.station.connect()
    check.station.wait(0.2)
    main, start_ns = check.main.mark(), check.station.now_ns
    _groups(check, client, 0, 4)
    stopped = _rates(check, client)
    found.expect(not any(stopped.values()), f"stopped: {_named(stopped)}")
    _groups(check, client, 1, 4)
    started = _rates(check, client)
    found.expect(all(2.5 <= one <= 5.5 for one in started.values()), f"at 4 Hz: {_named(started)}")
    _interval(check, client, found)
    seconds = (check.station.now_ns - start_ns) / NS_PER_S
    before, kept = check.rate("ATTITUDE"), len(check.main.sent("ATTITUDE", main)) / seconds
    is_kept = before * KEPT <= kept <= before / KEPT
    found.expect(before and is_kept, f"the other client keeps ATTITUDE ({kept:.1f} Hz)")
    client.beats = False
    return found.verdict()


def _groups(check: VehicleCheck, client: GroundStation, start: int, rate: int) -> None:
    target = check.station.address
    for group in GROUPS:
        message = mavlink.MAVLink_request_data_stream_message(*target, group, rate, start)
        client.send_surely(message)
    check.station.wait(0.5)


def _rates(check: VehicleCheck, client: GroundStation) -> dict[str, float]:
    since = client.mark()
    check.station.wait(WATCH_S)
    names = [one.name for one in client.log[since:]]
    return {name: names.count(name) / WATCH_S for name in GROUP_MESSAGES}


def _interval(check: VehicleCheck, client: GroundStation, found: Findings) -> None:
    number = mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED
    result = client.result_of(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, number, 50_000)
    found.expect(result == mavlink.MAV_RESULT_ACCEPTED, f"511: {result_name(result)}")
    since = client.mark()
    check.station.wait(1.5)
    rate = sum(one.name == "LOCAL_POSITION_NED" for one in client.log[since:]) / 1.5
    found.expect(8 <= rate <= 24, f"LOCAL_POSITION_NED {rate:.0f} Hz of 20")
    for name, message in (
        ("510", client.command_long(mavlink.MAV_CMD_GET_MESSAGE_INTERVAL, number)),
        ("512/244", client.command_long(mavlink.MAV_CMD_REQUEST_MESSAGE, 244, number)),
    ):
        answer = client.ask(message, "MESSAGE_INTERVAL", lambda one: one.message_id == number)
        interval = answer.message.interval_us if answer else None
        found.expect(interval == 50_000, f"{name}: interval {interval} us")


def _named(values: dict[str, float]) -> str:
    return ", ".join(f"{name} {value:.1f}" for name, value in values.items())


def _numbers(values: tuple[float, ...]) -> str:
    return ", ".join(f"{value:.3g}" for value in values)


def require(check: VehicleCheck, name: str) -> RowVerdict | None:
    """Return why a row about a sensor cannot be judged, None if its message is in the window."""
    if check.seen(name):
        return None
    status = check.newest("SYS_STATUS")
    if status is not None and not status.onboard_control_sensors_present & PROXIMITY:
        return not_applicable(f"no {name}; SYS_STATUS shows no proximity sensor")
    return failed(f"no {name} in {check.window.seconds:.0f} s")


UNKNOWN: Final = 65_535
YAWS: Final = range(8)
"""MAV_SENSOR_ROTATION_NONE, YAW_45 ... YAW_315: the directions of a radar."""
SECTOR_DEG: Final = 45.0
FULL_DEG: Final = 360.0
NOISE_CM: Final = 10
SAME_TIME_NS: Final = NS_PER_S // 4
"""Two messages of 5 Hz whose times differ by less show the same surroundings."""
MAX_WRONG_SHARE: Final = 0.1
"""A sonar may lose an echo in one of the two messages."""
WHEEL_DISTANCE: Final = 9000
RANGE_BITS: Final = (
    mavlink.MAV_SYS_STATUS_SENSOR_LASER_POSITION | mavlink.MAV_SYS_STATUS_SENSOR_PROXIMITY
)


@row(
    15,
    "OBSTACLE_DISTANCE 5 Hz: values from left to right in the frame of the body, the rest unknown",
    suffers="MAVProxy status, QGroundControl, MAVSDK direct, Foxglove",
    source="MAVLink guide, common.xml OBSTACLE_DISTANCE; MAVProxy proximity",
)
def obstacle_distance(check: VehicleCheck) -> RowVerdict:
    """Judge rate, geometry and values."""
    missing = require(check, "OBSTACLE_DISTANCE")
    if missing:
        return missing
    found, one = rated(check, "OBSTACLE_DISTANCE", 5, 10)
    beams = beams_of(one)
    found.expect(abs(one.angle_offset) <= FULL_DEG / 2, f"angle_offset {one.angle_offset:g}")
    step_deg = step_of(one)
    is_right = step_deg > 0 and step_deg * len(beams) <= FULL_DEG
    found.expect(is_right, f"{len(beams)} values, step {step_deg:g}")
    found.expect(one.frame == mavlink.MAV_FRAME_BODY_FRD, f"frame {one.frame}")
    most = one.max_distance + 1
    is_right = all(value <= most or value == UNKNOWN for value in beams)
    is_known = any(value != UNKNOWN for value in beams)
    found.expect(is_right and is_known, f"distances {beams[:8]}, max {one.max_distance} cm")
    return found.verdict()


def step_of(message: Any) -> float:
    """Return the angle from one value of OBSTACLE_DISTANCE to the next."""
    return float(message.increment_f or message.increment)


def beams_of(message: Any) -> list[int]:
    """Return the values of OBSTACLE_DISTANCE without those at the end that are unknown."""
    values = [int(distance) for distance in message.distances]
    while values and values[-1] == UNKNOWN:
        values.pop()
    return values


def sectors_of(message: Any) -> dict[int, list[int]]:
    """Return the distances of OBSTACLE_DISTANCE in the sector of each orientation."""
    found: dict[int, list[int]] = {}
    for number, value in enumerate(beams_of(message)):
        angle_deg = message.angle_offset + number * step_of(message)
        orientation = round(angle_deg / SECTOR_DEG) % len(YAWS)
        found.setdefault(orientation, []).append(min(value, int(message.max_distance)))
    return found


@row(
    16,
    "DISTANCE_SENSOR for each direction: nearest of its sonars, max_distance without echo",
    suffers="QGroundControl's radar; Mission Planner drops values at the limits",
    source="QGroundControl VehicleDistanceSensorFactGroup.cc; Mission Planner",
)
def distance_sensors(check: VehicleCheck) -> RowVerdict:
    """Judge the orientations, the field of view, and the values against OBSTACLE_DISTANCE."""
    missing = require(check, "DISTANCE_SENSOR")
    if missing:
        return missing
    found = Findings()
    newest = {one.message.orientation: one.message for one in check.seen("DISTANCE_SENSOR")}
    levels = {number: one for number, one in newest.items() if number in YAWS}
    scans = [(one.at_ns, sectors_of(one.message)) for one in check.seen("OBSTACLE_DISTANCE")]
    wanted = sorted({number for _, scan in scans for number in scan}) or sorted(levels)
    found.expect(levels and sorted(levels) == wanted, f"orientations {sorted(newest)}")
    for orientation, one in sorted(levels.items()):
        is_right = one.current_distance <= one.max_distance and one.min_distance < one.max_distance
        is_right = is_right and 0 <= one.horizontal_fov <= 2 * pi
        fact = f"{orientation}: {one.current_distance} of {one.max_distance} cm"
        found.expect(is_right, f"{fact}, fov {one.horizontal_fov:.3f}")
        _expect_same_readings(check, found, orientation, scans)
    return found.verdict()


def _expect_same_readings(
    check: VehicleCheck,
    found: Findings,
    orientation: int,
    scans: list[tuple[int, dict[int, list[int]]]],
) -> None:
    """Compare the values of a direction with the scans of the same time."""
    count = wrong = 0
    for frame in check.seen("DISTANCE_SENSOR"):
        if frame.message.orientation != orientation:
            continue
        near = [
            min(scan[orientation])
            for at_ns, scan in scans
            if orientation in scan and abs(at_ns - frame.at_ns) <= SAME_TIME_NS
        ]
        if near:
            low, high = min(near) - NOISE_CM, max(near) + NOISE_CM
            count += 1
            wrong += not low <= frame.message.current_distance <= high
    if wrong > count * MAX_WRONG_SHARE:
        found.expect(False, f"{orientation}: {wrong} of {count} values differ from the scan")


@row(
    17,
    "RANGEFINDER 2 Hz (nearest), WHEEL_DISTANCE on request",
    suffers="DroneKit, Mission Planner, mavros: no range",
    source="DroneKit; Mission Planner; mavros; ArduPilot Rover/GCS_MAVLink_Rover.cpp",
    profiles=ARDUPILOTS,
)
def rangefinder(check: VehicleCheck) -> RowVerdict:
    """Judge the rate, and ask for the wheels. A vehicle may have neither sensor."""
    found = Findings()
    status = check.newest("SYS_STATUS")
    has_range = status is None or bool(status.onboard_control_sensors_present & RANGE_BITS)
    if has_range or check.seen("RANGEFINDER"):
        check.expect_rate(found, "RANGEFINDER", 2, 2)
    answer = check.main.request(WHEEL_DISTANCE, "WHEEL_DISTANCE")
    if answer is not None:
        count = answer.message.count
        found.expect(count >= 1, f"WHEEL_DISTANCE count {count}")
        return found.verdict()
    # ArduPilot accepts the request and sends nothing if it has no wheel encoders.
    result = check.main.result_of(mavlink.MAV_CMD_REQUEST_MESSAGE, WHEEL_DISTANCE)
    found.expect(
        result is not None, f"no wheel encoders: 512/{WHEEL_DISTANCE} {result_name(result)}"
    )
    verdict = found.verdict()
    if verdict.status is RowStatus.PASS and not has_range:
        return not_applicable(f"no rangefinder in SYS_STATUS; {verdict.evidence}")
    return verdict


ORIGIN: Final = mavlink.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN
REQUEST_MESSAGE: Final = mavlink.MAV_CMD_REQUEST_MESSAGE
AVAILABLE_MODES: Final = 435
CURRENT_MODE: Final = 436
MODES_S: Final = 2.0
MOVED_E7: Final = 10_000
"""About 100 m."""
STAMP_NS: Final = 1_234_567_890_123


@row(
    14,
    "GPS_GLOBAL_ORIGIN on request 49 and after SET_GPS_GLOBAL_ORIGIN",
    suffers="mavros, MAVSDK; ArduPilot ignores local setpoints without an origin",
    source="mavros; MAVSDK; ArduPilot GCS_MAVLink/GCS_Common.cpp",
)
def origin(check: VehicleCheck) -> RowVerdict:
    """Request the origin, and set it to its present value."""
    found = Findings()
    answer = check.main.request(ORIGIN, "GPS_GLOBAL_ORIGIN")
    if answer is None:
        return failed("512/49: no GPS_GLOBAL_ORIGIN")
    one = answer.message
    found.fact(f"origin {one.latitude} {one.longitude}")
    again = mavlink.MAVLink_set_gps_global_origin_message(
        check.target, one.latitude, one.longitude, one.altitude
    )
    echo = check.main.ask(again, "GPS_GLOBAL_ORIGIN")
    found.expect(echo, f"SET_GPS_GLOBAL_ORIGIN: {'echoed' if echo else 'no GPS_GLOBAL_ORIGIN'}")
    if echo is not None:
        is_same = (echo.message.latitude, echo.message.longitude) == (one.latitude, one.longitude)
        found.expect(is_same, f"echo {echo.message.latitude} {echo.message.longitude}")
    if check.options.allow_motion and row_steps.start(check, row_steps.GUIDED, found):
        _expect_fixed_origin(check, found, one)
        row_steps.stand(check)
    return found.verdict()


def _expect_fixed_origin(check: VehicleCheck, found: Findings, one: Any) -> None:
    """Try to move the origin of an armed vehicle."""
    moved = mavlink.MAVLink_set_gps_global_origin_message(
        check.target, one.latitude + MOVED_E7, one.longitude, one.altitude
    )
    check.main.send_surely(moved)
    check.station.wait(0.5)
    now = check.main.request(ORIGIN, "GPS_GLOBAL_ORIGIN")
    is_fixed = now is not None and now.message.latitude == one.latitude
    found.expect(is_fixed, f"moved while armed: {'refused' if is_fixed else 'taken'}")
    if now is not None and not is_fixed:
        again = mavlink.MAVLink_set_gps_global_origin_message(
            check.target, one.latitude, one.longitude, one.altitude
        )
        check.main.ask(again, "GPS_GLOBAL_ORIGIN")


@row(
    25,
    "AVAILABLE_MODES and CURRENT_MODE, or UNSUPPORTED at once",
    suffers="QGroundControl: waits while connecting",
    source="MAVLink guide, standard modes",
)
def modes(check: VehicleCheck) -> RowVerdict:
    """Ask for all modes and for the present one."""
    found, since = Findings(), check.main.mark()
    for number, name in ((AVAILABLE_MODES, "AVAILABLE_MODES"), (CURRENT_MODE, "CURRENT_MODE")):
        result = check.main.result_of(REQUEST_MESSAGE, number)
        found.expect(result is not None, f"{name}: {result_name(result)}")
        if result != mavlink.MAV_RESULT_ACCEPTED:
            continue
        if number == AVAILABLE_MODES:
            _expect_modes(check, found, since)
        else:
            heard = check.main.heard(name, since)
            current = heard[-1] if heard else check.main.request(number, name)
            mode = None if current is None else current.message.custom_mode
            found.expect(mode == check.mode, f"CURRENT_MODE {mode}, HEARTBEAT {check.mode}")
    return found.verdict()


def _is_index(index: int, one: Any) -> bool:
    return bool(one.mode_index == index)


def _expect_modes(check: VehicleCheck, found: Findings, since: int) -> None:
    """Expect all modes; ask again for those that were lost, as QGroundControl does."""
    name, listed = "AVAILABLE_MODES", dict[int, Any]()

    def take() -> bool:
        frames = check.main.heard(name, since)
        listed.update({frame.message.mode_index: frame.message for frame in frames})
        return bool(listed) and len(listed) >= next(iter(listed.values())).number_modes

    if not check.station.wait(MODES_S, take) and check.station.is_lossy:
        count = next(iter(listed.values())).number_modes if listed else 1
        for index in range(1, count + 1):
            if index not in listed:
                asked = check.main.command_long(REQUEST_MESSAGE, AVAILABLE_MODES, index)
                check.main.ask(asked, name, partial(_is_index, index))
        take()
    count = next(iter(listed.values())).number_modes if listed else 0
    names = [one.mode_name.decode("utf-8", "replace") for one in listed.values()]
    found.expect(listed and len(listed) == count, f"{len(listed)} of {count} modes: {names}")


@row(
    48,
    "TIMESYNC and PING answered to their sender; SYSTEM_TIME 1 Hz",
    suffers="mavros, MAVSDK: no common time",
    source="MAVLink guide, time synchronization, ping; mavros; MAVSDK",
)
def clocks(check: VehicleCheck) -> RowVerdict:
    """Send TIMESYNC with a target, and PING."""
    found = Findings()
    target = {"target_system": check.target, "target_component": 1}
    answer = check.main.ask(
        ExtraMessage(TIMESYNC, ts1=STAMP_NS, **target), "TIMESYNC", lambda one: one.tc1 != 0
    )
    if found.expect(answer, f"TIMESYNC: {'answered' if answer else 'no answer'}") and answer:
        one = answer.message
        found.expect(one.ts1 == STAMP_NS, f"ts1 {one.ts1}")
        echoed = one.target_system, one.target_component
        found.expect(echoed == (check.main.system, COMPONENT), f"TIMESYNC target {echoed}")
    ping = mavlink.MAVLink_ping_message(STAMP_NS // 1000, 7, 0, 0)
    pong = check.main.ask(ping, "PING", lambda one: one.seq == 7)
    got = (pong.message.target_system, pong.message.target_component) if pong else None
    found.expect(got == (check.main.system, COMPONENT), f"PING answered to {got}")
    check.expect_rate(found, "SYSTEM_TIME", 1, 1)
    return found.verdict()
