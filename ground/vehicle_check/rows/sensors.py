"""Rows 15-17: the sonars as OBSTACLE_DISTANCE, DISTANCE_SENSOR and RANGEFINDER."""

from typing import Any, Final

from ground.vehicle_check.check import Check
from ground.vehicle_check.dialect import mavlink
from ground.vehicle_check.rows.streams import require
from ground.vehicle_check.verdict import Findings, Verdict, row

BEAMS: Final = 8
UNKNOWN: Final = 65_535
OFFSET_DEG: Final = -78.75
STEP_DEG: Final = 22.5
SECTORS: Final = {
    mavlink.MAV_SENSOR_ROTATION_YAW_270: (0,),
    mavlink.MAV_SENSOR_ROTATION_YAW_315: (1, 2),
    mavlink.MAV_SENSOR_ROTATION_NONE: (3, 4),
    mavlink.MAV_SENSOR_ROTATION_YAW_45: (5, 6),
    mavlink.MAV_SENSOR_ROTATION_YAW_90: (7,),
}
"""The beams of OBSTACLE_DISTANCE in the sector of each orientation."""
FIELD_OF_VIEW_RAD: Final = 0.785
NOISE_CM: Final = 10
WHEEL_DISTANCE: Final = 9000


@row(
    15,
    "OBSTACLE_DISTANCE 5 Hz: 8 values from left to right, offset -78.75, step 22.5, FRD",
    suffers="MAVProxy status, QGroundControl, MAVSDK direct, Foxglove",
)
def obstacle_distance(check: Check) -> Verdict:
    """Judge rate, geometry and values."""
    missing = require(check, "OBSTACLE_DISTANCE")
    if missing:
        return missing
    found = Findings()
    check.expect_rate(found, "OBSTACLE_DISTANCE", 5, 10)
    one = check.newest("OBSTACLE_DISTANCE")
    found.expect(abs(one.angle_offset - OFFSET_DEG) < 0.01, f"angle_offset {one.angle_offset:g}")
    found.expect(abs(one.increment_f - STEP_DEG) < 0.01, f"increment_f {one.increment_f:g}")
    found.expect(one.frame == mavlink.MAV_FRAME_BODY_FRD, f"frame {one.frame}")
    beams, rest = list(one.distances[:BEAMS]), one.distances[BEAMS:]
    found.expect(all(value == UNKNOWN for value in rest), f"{len(rest)} more values")
    most = one.max_distance + 1
    is_right = all(value <= most or value == UNKNOWN for value in beams)
    is_known = any(value != UNKNOWN for value in beams)
    found.expect(is_right and is_known, f"distances {beams}, max {one.max_distance} cm")
    return found.verdict()


@row(
    16,
    "DISTANCE_SENSOR for 5 directions: nearest of its sonars, max_distance without echo",
    suffers="QGroundControl's radar; Mission Planner drops values at the limits",
)
def distance_sensors(check: Check) -> Verdict:
    """Judge the orientations, the field of view, and the values against OBSTACLE_DISTANCE."""
    missing = require(check, "DISTANCE_SENSOR")
    if missing:
        return missing
    found = Findings()
    frames = check.seen("DISTANCE_SENSOR")
    newest = {one.message.orientation: one.message for one in frames}
    found.expect(set(newest) == set(SECTORS), f"orientations {sorted(newest)}")
    for orientation, one in sorted(newest.items()):
        is_right = one.current_distance <= one.max_distance and one.min_distance < one.max_distance
        is_right = is_right and abs(one.horizontal_fov - FIELD_OF_VIEW_RAD) < 0.01
        fact = f"{orientation}: {one.current_distance} of {one.max_distance} cm"
        found.expect(is_right, f"{fact}, fov {one.horizontal_fov:.3f}")
        if orientation in SECTORS:
            _expect_nearest(check, found, one)
    return found.verdict()


def _expect_nearest(check: Check, found: Findings, sensor: Any) -> None:
    nearest = [
        min((_distance(one.message, beam) for beam in SECTORS[sensor.orientation]), default=0)
        for one in check.seen("OBSTACLE_DISTANCE")
    ]
    if nearest:
        low, high = min(nearest) - NOISE_CM, max(nearest) + NOISE_CM
        is_near = low <= sensor.current_distance <= high
        fact = f"{sensor.orientation} beside beams {min(nearest)}-{max(nearest)}"
        found.expect(is_near, fact) if not is_near else None


def _distance(message: Any, beam: int) -> int:
    return min(int(message.distances[beam]), int(message.max_distance))


@row(
    17,
    "RANGEFINDER 2 Hz (nearest), WHEEL_DISTANCE on request",
    suffers="DroneKit, Mission Planner, mavros: no range",
)
def rangefinder(check: Check) -> Verdict:
    """Judge the rate, and ask for the wheels."""
    found = Findings()
    check.expect_rate(found, "RANGEFINDER", 2, 2)
    answer = check.main.request(WHEEL_DISTANCE, "WHEEL_DISTANCE")
    count = answer.message.count if answer else None
    found.expect(answer and count and count >= 2, f"WHEEL_DISTANCE count {count}")
    return found.verdict()
