"""What a robot tells in words: /rosout, and /diagnostics with a level for each part."""

import time
from collections.abc import Callable
from typing import Final

from rosbags.typesys.stores.ros2_jazzy import diagnostic_msgs__msg__DiagnosticArray as Diagnostics
from rosbags.typesys.stores.ros2_jazzy import (
    diagnostic_msgs__msg__DiagnosticStatus as Part,
)  # its message for one component
from rosbags.typesys.stores.ros2_jazzy import diagnostic_msgs__msg__KeyValue as KeyValue
from rosbags.typesys.stores.ros2_jazzy import rcl_interfaces__msg__Log as Log

from gateways.ros2.node import RosNode
from gateways.ros2.telemetry import header, time_of
from gateways.ros2.wire import ROSOUT
from ground.client.status_line import reason_of, state_of
from protocol.outcome import doubt_of
from protocol.wire.enums import Severity, Vehicle
from protocol.wire.messages import LeaseStatus, NavigatorStatus, PlanarOdometry
from runtime.units import NS_PER_S

INFO: Final = 20
WARN: Final = 30
ERROR: Final = 40
FATAL: Final = 50
OK: Final = 0
STALE: Final = 3
AGAIN_NS: Final = 30 * NS_PER_S
"""Time after which the same words are logged again."""

MAX_TOLD: Final = 100


def level_of(severity: int) -> int:
    """Return the level of a log for a severity of MAVLink, whose lowest number is the worst."""
    if severity <= Severity.CRITICAL:
        return FATAL
    if severity <= Severity.ERROR:
        return ERROR
    return WARN if severity <= Severity.WARNING else INFO


class Reporter:
    """Logs to /rosout; `note` shows each line of a level from WARN on to the user, too."""

    def __init__(self, node: RosNode, now_ns: Callable[[], int], note: Callable[[str], None]):
        self._node, self._now_ns, self._note = node, now_ns, note
        self._log = node.publisher("/rosout", "rcl_interfaces/msg/Log", ROSOUT)
        self._diagnostics = node.publisher("/diagnostics", "diagnostic_msgs/msg/DiagnosticArray")
        self._name = ".".join(f"{node.name.namespace}/{node.name.name}".strip("/").split("/"))
        self._told: dict[str, int] = {}

    def log(self, level: int, text: str) -> None:
        """Log a line."""
        self._log.publish(Log(time_of(time.time_ns()), level, self._name, text, "", "", 0))
        if level >= WARN:
            self._note(text)

    def warn_once(self, text: str) -> None:
        """Log a warning, but not the same one over and over."""
        now_ns = self._now_ns()
        if now_ns - self._told.get(text, -AGAIN_NS) < AGAIN_NS:
            return
        if len(self._told) >= MAX_TOLD:
            self._told.clear()
        self._told[text] = now_ns
        self.log(WARN, text)

    def diagnose(self, *parts: Part) -> None:
        """Publish the state of all parts."""
        found = Diagnostics(header(time.time_ns(), ""), list(parts))
        self._diagnostics.publish(found)

    def part(self, level: int, name: str, text: str, **values: object) -> Part:
        """Return the state of a part, with its values in words."""
        pairs = [KeyValue(key, str(value)) for key, value in values.items()]
        return Part(level, f"{self._name}: {name}", text, self._name, pairs)

    def vehicle(
        self, status: NavigatorStatus | None, pose: PlanarOdometry | None, lease: LeaseStatus | None
    ) -> Part:
        """Return the state of the robot."""
        if status is None:
            return self.part(STALE, "robot", "no telemetry arrives from the robot")
        levels: dict[int, int] = {Vehicle.ACTIVE: OK, Vehicle.STANDBY: OK, Vehicle.BOOT: 1}
        level = levels.get(status.vehicle, 2)
        doubt_m = None if pose is None else doubt_of(pose)
        return self.part(
            level,
            "robot",
            f"{state_of(status)} {reason_of(status)}".strip(),
            goal_distance_m=f"{status.goal_distance_m:.3f}",
            position_doubt_m="unknown" if doubt_m is None else f"{doubt_m:.3f}",
            operator=lease.name if lease is not None and lease.held else "",
        )
