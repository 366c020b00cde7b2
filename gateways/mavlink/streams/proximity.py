"""Messages about the sonars and the wheels.

Sonar 0 looks right and 7 left, 22.5 degrees apart; MAVLink counts clockwise, from left to right.
Nothing is sent before the robot's own parameters are read: without its farthest range nobody knows
what no echo means.
"""

from collections.abc import Sequence
from math import inf, radians
from typing import Final

from gateways.mavlink.dialect import MavMessage, mavlink
from gateways.mavlink.vehicle import Vehicle
from protocol.wire.messages import SonarScan

SONARS: Final = 8
BETWEEN_DEG: Final = 22.5
LEFTMOST_DEG: Final = -BETWEEN_DEG * (SONARS - 1) / 2
UNUSED: Final = 0xFFFF
DISTANCES: Final = 72
MIN_CM: Final = 0
SECTOR_RAD: Final = radians(45.0)
VERTICAL_RAD: Final = radians(BETWEEN_DEG)
NOT_MEASURED: Final = 0xFF
SECTORS: Final = (
    (mavlink.MAV_SENSOR_ROTATION_YAW_270, (7,)),
    (mavlink.MAV_SENSOR_ROTATION_YAW_315, (6, 5)),
    (mavlink.MAV_SENSOR_ROTATION_NONE, (4, 3)),
    (mavlink.MAV_SENSOR_ROTATION_YAW_45, (2, 1)),
    (mavlink.MAV_SENSOR_ROTATION_YAW_90, (0,)),
)
"""The sonars of each sector of 45 degrees, clockwise from the left."""
WHEELS: Final = 16


def max_cm(vehicle: Vehicle) -> int | None:
    """Return the farthest range of a sonar, None while it is unknown."""
    longest_m = vehicle.parameters.get("sonar_max_m")
    return None if longest_m is None else round(longest_m * 100)


def ranges_m(scan: SonarScan) -> list[float | None]:
    """Return the range of each sonar: infinite without an echo, None if it has failed."""
    found: list[float | None] = []
    for sonar, range_mm in enumerate(scan.range_mm):
        bit = 1 << sonar
        if not scan.valid & bit:
            found.append(None)
        else:
            found.append(range_mm / 1000 if scan.echo & bit else inf)
    return found


def obstacle_distance(vehicle: Vehicle, now_ns: int) -> Sequence[MavMessage]:
    """Return OBSTACLE_DISTANCE: max + 1 without an echo, 65535 for a failed sonar."""
    scan, longest_cm = vehicle.snapshot.scan, max_cm(vehicle)
    if scan is None or longest_cm is None:
        return ()
    distances = [UNUSED] * DISTANCES
    for place, range_m in enumerate(reversed(ranges_m(scan))):
        if range_m is not None:
            distances[place] = round(min(range_m * 100, longest_cm + 1))
    message = mavlink.MAVLink_obstacle_distance_message(
        vehicle.boot_us(now_ns),
        mavlink.MAV_DISTANCE_SENSOR_ULTRASOUND,
        distances,
        int(BETWEEN_DEG),
        MIN_CM,
        longest_cm,
        increment_f=BETWEEN_DEG,
        angle_offset=LEFTMOST_DEG,
        frame=mavlink.MAV_FRAME_BODY_FRD,
    )
    return (message,)


def distance_sensors(vehicle: Vehicle, now_ns: int) -> Sequence[MavMessage]:
    """Return a DISTANCE_SENSOR per sector, with the nearest echo of its sonars.

    Without an echo it is the farthest range. A sector whose sonars have all failed is not sent. A
    touching obstacle is shown at 1 cm, because Mission Planner ignores ranges of 0.
    """
    scan, longest_cm = vehicle.snapshot.scan, max_cm(vehicle)
    if scan is None or longest_cm is None:
        return ()
    measured, time_ms = ranges_m(scan), vehicle.boot_ms(now_ns)
    found = []
    for number, (rotation, sonars) in enumerate(SECTORS):
        inside = [range_m for sonar in sonars if (range_m := measured[sonar]) is not None]
        if inside:
            here_cm = max(1, round(min(*inside, longest_cm / 100) * 100))
            fields = (MIN_CM, longest_cm, here_cm, mavlink.MAV_DISTANCE_SENSOR_ULTRASOUND)
            message = mavlink.MAVLink_distance_sensor_message(
                *(time_ms, *fields, number, rotation, NOT_MEASURED),
                horizontal_fov=SECTOR_RAD,
                vertical_fov=VERTICAL_RAD,
            )
            found.append(message)
    return found


def rangefinder(vehicle: Vehicle, now_ns: int) -> Sequence[MavMessage]:
    """Return RANGEFINDER: the nearest echo; the farthest range if there is none."""
    scan, longest_cm = vehicle.snapshot.scan, max_cm(vehicle)
    measured = [] if scan is None else [one for one in ranges_m(scan) if one is not None]
    if not measured or longest_cm is None:
        return ()
    return (mavlink.MAVLink_rangefinder_message(min(*measured, longest_cm / 100), 0.0),)


def wheel_distance(vehicle: Vehicle, now_ns: int) -> Sequence[MavMessage]:
    """Return WHEEL_DISTANCE: the distances of the left and the right wheel."""
    wheels, m_per_tick = vehicle.snapshot.wheels, vehicle.parameters.get("m_per_tick")
    if wheels is None or m_per_tick is None:
        return ()
    distances_m = [0.0] * WHEELS
    distances_m[:2] = wheels.left * m_per_tick, wheels.right * m_per_tick
    return (mavlink.MAVLink_wheel_distance_message(vehicle.boot_us(now_ns), 2, distances_m),)
