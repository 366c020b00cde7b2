"""What a robot tells in words: lines for /rosout, and a level for each part in /diagnostics."""

from collections.abc import Sequence
from typing import Final

from rosbags.typesys.stores.ros2_jazzy import diagnostic_msgs__msg__DiagnosticArray as Diagnostics
from rosbags.typesys.stores.ros2_jazzy import (
    diagnostic_msgs__msg__DiagnosticStatus as Part,
)  # its message for one component
from rosbags.typesys.stores.ros2_jazzy import diagnostic_msgs__msg__KeyValue as KeyValue
from rosbags.typesys.stores.ros2_jazzy import rcl_interfaces__msg__Log as Log

from ground.client.status_line import reason_of, state_of
from ground.ros2.messages import header, time_of
from protocol.outcome import doubt_of
from protocol.wire.enums import Severity, Vehicle
from protocol.wire.messages import LeaseStatus, NavigatorStatus, PlanarOdometry

INFO: Final = 20
WARN: Final = 30
ERROR: Final = 40
FATAL: Final = 50
OK: Final = 0
STALE: Final = 3


def level_of(severity: int) -> int:
    """Return the level of a log for a severity of MAVLink, whose lowest number is the worst."""
    if severity <= Severity.CRITICAL:
        return FATAL
    if severity <= Severity.ERROR:
        return ERROR
    return WARN if severity <= Severity.WARNING else INFO


def logger_name(node: str) -> str:
    """Return the name of a node, such as `/r1/sidestep`, as logs write it."""
    return node.strip("/").replace("/", ".")


def log_line(time_ns: int, level: int, logger: str, text: str) -> Log:
    """Return rcl_interfaces/Log."""
    return Log(time_of(time_ns), level, logger, text, "", "", 0)


def diagnostics(time_ns: int, parts: Sequence[Part]) -> Diagnostics:
    """Return diagnostic_msgs/DiagnosticArray."""
    return Diagnostics(header(time_ns, ""), list(parts))


def part(logger: str, level: int, name: str, text: str, **values: object) -> Part:
    """Return the state of a part, with its values in words."""
    pairs = [KeyValue(key, str(value)) for key, value in values.items()]
    return Part(level, f"{logger}: {name}", text, logger, pairs)


def robot_part(
    logger: str,
    status: NavigatorStatus | None,
    pose: PlanarOdometry | None,
    lease: LeaseStatus | None,
) -> Part:
    """Return the state of the robot."""
    if status is None:
        return part(logger, STALE, "robot", "no telemetry arrives from the robot")
    levels: dict[int, int] = {Vehicle.ACTIVE: OK, Vehicle.STANDBY: OK, Vehicle.BOOT: 1}
    level = levels.get(status.vehicle, 2)
    doubt_m = None if pose is None else doubt_of(pose)
    return part(
        logger,
        level,
        "robot",
        f"{state_of(status)} {reason_of(status)}".strip(),
        goal_distance_m=f"{status.goal_distance_m:.3f}",
        position_doubt_m="unknown" if doubt_m is None else f"{doubt_m:.3f}",
        operator=lease.name if lease is not None and lease.held else "",
    )
