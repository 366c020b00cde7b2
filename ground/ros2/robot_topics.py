"""Turn the messages of a robot into those of its topics of ROS 2, live or from a recording."""

from collections.abc import Iterator, Mapping
from typing import Any, Final, TypeAlias

from rosbags.typesys.stores.ros2_jazzy import rosgraph_msgs__msg__Clock as ClockMessage
from rosbags.typesys.stores.ros2_jazzy import std_msgs__msg__String as String

from ground.ros2 import markers, messages
from ground.ros2.messages import Geometry, RosClock, WheelReader, WheelState
from ground.ros2.offer import SCAN, SONAR_FRAMES
from protocol.wire.message import Message
from protocol.wire.messages import (
    AvoidanceDecision,
    NavigatorStatus,
    PlanarOdometry,
    SonarScan,
    SystemTime,
    WheelTicks,
)
from runtime.units import NS_PER_S, NS_PER_US

UNCERTAIN_NS: Final = NS_PER_S // 4
"""Time after the first message in which a robot of a simulation shows the clock of that."""

Shown: TypeAlias = tuple[str, Any]
"""The name of a topic in the table, and a message for it."""


class RobotTopics:
    """Of one robot; times are those of ROS, which `clock` makes of the stamps of the robot.

    Without `is_simulated` the first messages tell whether this is a simulation. Until then nothing
    is shown, because its stamps could not be given.
    """

    def __init__(self, robot: str, *, scan: bool = False, is_simulated: bool | None = None) -> None:
        self.clock = RosClock()
        self.clock.is_simulated = bool(is_simulated)
        self._is_certain = is_simulated is not None
        self._begins_ns: int | None = None
        self.geometry = Geometry()
        self._robot, self._scan = robot, scan
        self._is_shaped = False
        self._reader = WheelReader()
        self._wheels: WheelState | None = None
        self._is_planning = True  # the first plan is sent even if it is empty

    def take(self, message: Message, arrived_ns: int) -> Iterator[Shown]:
        """Yield what follows at once from a message that arrived at this time of day."""
        if isinstance(message, SystemTime):
            self.clock.is_simulated = self._is_certain = True
            yield "/clock", ClockMessage(messages.time_of(message.time_unix_usec * NS_PER_US))
        elif not self._knows_time(arrived_ns):
            return
        elif isinstance(message, PlanarOdometry):
            yield from self._odometry(message, self._stamp(message.time_ns, arrived_ns))
        elif isinstance(message, SonarScan):
            yield from self._ranges(message, self._stamp(message.time_ns, arrived_ns))
        elif isinstance(message, WheelTicks):
            stamp_ns = self._stamp(message.time_ns, arrived_ns)
            self._wheels = self._reader.read(message, self.geometry, stamp_ns)
            yield "joint_states", messages.joint_states(self._wheels)

    def _knows_time(self, arrived_ns: int) -> bool:
        if self._begins_ns is None:
            self._begins_ns = arrived_ns
        self._is_certain |= arrived_ns - self._begins_ns >= UNCERTAIN_NS
        return self._is_certain

    def _stamp(self, stamp_ns: int, arrived_ns: int) -> int:
        self.clock.note(stamp_ns, arrived_ns)
        return self.clock.of(stamp_ns)

    def _odometry(self, pose: PlanarOdometry, stamp_ns: int) -> Iterator[Shown]:
        yield "odom", messages.odometry(pose, stamp_ns)
        found = [messages.base_transform(pose, stamp_ns)]
        if self._wheels is not None:
            found += messages.wheel_transforms(self._wheels, self.geometry)
        yield "tf", messages.transforms(found)

    def _ranges(self, scan: SonarScan, stamp_ns: int) -> Iterator[Shown]:
        for sonar, found in messages.ranges(scan, self.geometry, stamp_ns):
            yield SONAR_FRAMES[sonar], found
        if self._scan:
            yield SCAN, messages.laser_scan(scan, self.geometry, stamp_ns)

    def shape(self, parameters: Mapping[str, float]) -> Iterator[Shown]:
        """Yield what follows from the dimensions of the robot, if they are new."""
        geometry = Geometry.of(parameters)
        if geometry != self.geometry or not self._is_shaped:
            self.geometry, self._is_shaped = geometry, True
            yield "tf_static", messages.static_transforms(geometry, 0)
            yield "robot_description", String(messages.urdf(self._robot, geometry))

    def plan(
        self, pose: PlanarOdometry, status: NavigatorStatus, decision: AvoidanceDecision | None
    ) -> Iterator[Shown]:
        """Yield the way to the goal, and once an empty one when there is none any more."""
        places = markers.places_of(pose, status, decision)
        if places or self._is_planning:
            yield "plan", markers.plan(places, self.clock.of(pose.time_ns))
        self._is_planning = bool(places)

    def markers(
        self,
        pose: PlanarOdometry,
        status: NavigatorStatus,
        decision: AvoidanceDecision | None,
        scan: SonarScan | None,
    ) -> Shown:
        """Return what the robot intends and senses, as drawings."""
        places = markers.places_of(pose, status, decision)
        stamp_ns = self.clock.of(pose.time_ns)
        found = markers.markers(pose, places, decision, scan, self.geometry, stamp_ns)
        return "markers", found
