"""Rows 7, 8, 11-13, 18, 26: the streams that clients need, and changes of their rates."""

from math import isfinite
from typing import Any, Final

from runtime.units import NS_PER_S
from vehicle_check.check import ONE_CLIENT, Check
from vehicle_check.dialect import mavlink
from vehicle_check.session import Client, result_name
from vehicle_check.verdict import Findings, Verdict, failed, not_applicable, row

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


def rated(check: Check, name: str, low_hz: float, high_hz: float) -> tuple[Findings, Any]:
    """Judge the rate of a message; return its newest one, too, None if there is none."""
    found = Findings()
    check.expect_rate(found, name, low_hz, high_hz)
    return found, check.newest(name)


@row(
    7,
    "SYS_STATUS 1-2 Hz with the bits PREARM, GEOFENCE and PROXIMITY",
    suffers="MAVSDK health, MAVProxy fence, QGroundControl",
)
def system_status(check: Check) -> Verdict:
    """Judge rate and present bits."""
    found, one = rated(check, "SYS_STATUS", 1, 2)
    if one is not None:
        bits = one.onboard_control_sensors_present
        for name, bit in (("PREARM", PREARM), ("GEOFENCE", GEOFENCE), ("PROXIMITY", PROXIMITY)):
            is_needed = bit != PROXIMITY or check.seen("OBSTACLE_DISTANCE")
            fact = f"{name} {'present' if bits & bit else 'not present'}"
            found.expect(bits & bit or not is_needed, fact)
    return found.verdict()


@row(
    8,
    "EKF_STATUS_REPORT 1 Hz: absolute position, variances of its own",
    suffers="DroneKit is_armable and ekf_ok; Mission Planner's EKF light",
)
def ekf_status(check: Check) -> Verdict:
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
)
def global_position(check: Check) -> Verdict:
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
)
def gps(check: Check) -> Verdict:
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
)
def local_position(check: Check) -> Verdict:
    """Judge the rates."""
    found = Findings()
    for name, rate_hz in (
        ("LOCAL_POSITION_NED", 10),
        ("ATTITUDE", 10),
        ("VFR_HUD", 2),
        ("LOCAL_POSITION_NED_COV", 5),
        ("ODOMETRY", 5),
    ):
        check.expect_rate(found, name, rate_hz, rate_hz)
    return found.verdict()


@row(
    18,
    "HOME_POSITION and BATTERY_STATUS at 0.5 Hz or more",
    suffers="QGroundControl: asks for all streams again after 10 s",
)
def home_and_battery(check: Check) -> Verdict:
    """Judge the rates."""
    found = Findings()
    for name in ("HOME_POSITION", "BATTERY_STATUS"):
        check.expect_rate(found, name, 0.5, 10)
    return found.verdict()


@row(
    26,
    "REQUEST_DATA_STREAM and SET_MESSAGE_INTERVAL act, for one client only",
    suffers="QGroundControl, Mission Planner, MAVProxy, mavros: wrong rates",
)
def rates(check: Check) -> Verdict:
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


def _groups(check: Check, client: Client, start: int, rate: int) -> None:
    target = check.station.address
    for group in GROUPS:
        message = mavlink.MAVLink_request_data_stream_message(*target, group, rate, start)
        client.send_surely(message)
    check.station.wait(0.5)


def _rates(check: Check, client: Client) -> dict[str, float]:
    since = client.mark()
    check.station.wait(WATCH_S)
    names = [one.name for one in client.log[since:]]
    return {name: names.count(name) / WATCH_S for name in GROUP_MESSAGES}


def _interval(check: Check, client: Client, found: Findings) -> None:
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


def require(check: Check, name: str) -> Verdict | None:
    """Return why a row about a sensor cannot be judged, None if its message is in the window."""
    if check.seen(name):
        return None
    status = check.newest("SYS_STATUS")
    if status is not None and not status.onboard_control_sensors_present & PROXIMITY:
        return not_applicable(f"no {name}; SYS_STATUS shows no proximity sensor")
    return failed(f"no {name} in {check.window.seconds:.0f} s")
