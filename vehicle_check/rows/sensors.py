"""Rows 15-17: the sonars as OBSTACLE_DISTANCE, DISTANCE_SENSOR and RANGEFINDER."""

from math import pi
from typing import Any, Final

from vehicle_check.check import Check
from vehicle_check.dialect import mavlink
from vehicle_check.rows.streams import rated, require
from vehicle_check.session import result_name
from vehicle_check.verdict import Findings, Status, Verdict, not_applicable, row

UNKNOWN: Final = 65_535
YAWS: Final = range(8)
"""MAV_SENSOR_ROTATION_NONE, YAW_45 ... YAW_315: the directions of a radar."""
SECTOR_DEG: Final = 45.0
FULL_DEG: Final = 360.0
NOISE_CM: Final = 10
WHEEL_DISTANCE: Final = 9000
RANGE_BITS: Final = (
    mavlink.MAV_SYS_STATUS_SENSOR_LASER_POSITION | mavlink.MAV_SYS_STATUS_SENSOR_PROXIMITY
)


@row(
    15,
    "OBSTACLE_DISTANCE 5 Hz: values from left to right in the frame of the body, the rest unknown",
    suffers="MAVProxy status, QGroundControl, MAVSDK direct, Foxglove",
)
def obstacle_distance(check: Check) -> Verdict:
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
    values = [int(one) for one in message.distances]
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
)
def distance_sensors(check: Check) -> Verdict:
    """Judge the orientations, the field of view, and the values against OBSTACLE_DISTANCE."""
    missing = require(check, "DISTANCE_SENSOR")
    if missing:
        return missing
    found = Findings()
    newest = {one.message.orientation: one.message for one in check.seen("DISTANCE_SENSOR")}
    levels = {number: one for number, one in newest.items() if number in YAWS}
    beams = [sectors_of(one.message) for one in check.seen("OBSTACLE_DISTANCE")]
    wanted = sorted({number for one in beams for number in one}) or sorted(levels)
    found.expect(levels and sorted(levels) == wanted, f"orientations {sorted(newest)}")
    for orientation, one in sorted(levels.items()):
        is_right = one.current_distance <= one.max_distance and one.min_distance < one.max_distance
        is_right = is_right and 0 <= one.horizontal_fov <= 2 * pi
        fact = f"{orientation}: {one.current_distance} of {one.max_distance} cm"
        found.expect(is_right, f"{fact}, fov {one.horizontal_fov:.3f}")
        nearest = [min(one[orientation]) for one in beams if orientation in one]
        if nearest:
            low, high = min(nearest) - NOISE_CM, max(nearest) + NOISE_CM
            if not low <= one.current_distance <= high:
                found.expect(False, f"{orientation} beside beams {min(nearest)}-{max(nearest)}")
    return found.verdict()


@row(
    17,
    "RANGEFINDER 2 Hz (nearest), WHEEL_DISTANCE on request",
    suffers="DroneKit, Mission Planner, mavros: no range",
)
def rangefinder(check: Check) -> Verdict:
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
    if verdict.status is Status.PASS and not has_range:
        return not_applicable(f"no rangefinder in SYS_STATUS; {verdict.evidence}")
    return verdict
