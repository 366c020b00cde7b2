"""What one robot offers as a ROS 2 node: its topics, services and parameters."""

import asyncio
import time
from collections.abc import Callable, Coroutine, Mapping
from contextlib import AsyncExitStack
from dataclasses import dataclass, replace
from typing import Any, Final

from rosbags.typesys.stores.ros2_jazzy import rosgraph_msgs__msg__Clock as ClockMessage
from rosbags.typesys.stores.ros2_jazzy import std_msgs__msg__String as String

from gateways.ros2 import drawing, telemetry
from gateways.ros2.navigation import Navigation
from gateways.ros2.node import RosGraph, RosNode, RosSession
from gateways.ros2.parameters import ParameterServices
from gateways.ros2.report import INFO, Reporter, level_of
from gateways.ros2.services import RobotServices
from gateways.ros2.velocity import VelocityCommands
from gateways.ros2.wire import (
    HUMBLE,
    LATCHED,
    NO_HASHES,
    SENSOR_DATA,
    EntityKind,
    Qos,
    TokenParts,
)
from ground.client.robot_link import RobotLink, finish
from ground.robot import Robot
from protocol.topics import CLOCK, DECISION, LEASE, ODOMETRY, SONAR, STATUS, TEXT, WHEELS
from protocol.wire.statustext import StatustextAssembler
from runtime.errors import RemoteError
from runtime.units import NS_PER_MS, NS_PER_US

NODE: Final = "sidestep"
OPERATOR: Final = "ros2"
"""The name that other operators see."""

TF: Final = Qos(depth=100)
SILENT_NS: Final = 1500 * NS_PER_MS
DRAW_S: Final = 0.5
PARAMETERS_S: Final = 5.0
"""Time between two looks at the parameters of the robot, which others may change."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FaceSettings:
    """How a robot is presented: `namespace` is absolute or empty, `scan` adds the topic scan."""

    namespace: str
    read_only: bool = False
    scan: bool = False


class RobotFace:
    """One robot as the node `sidestep` in its namespace."""

    def __init__(
        self,
        robot: Robot,
        session: RosSession,
        settings: FaceSettings,
        note: Callable[[str], None] = lambda _: None,
    ) -> None:
        self.robot, self.settings = robot, settings
        self.node = node = RosNode(session, settings.namespace, NODE)
        self.clock = telemetry.RosClock()
        self.geometry = telemetry.Geometry()
        self.limits = (0.0, 0.0)
        """The fastest speed (m/s) and turn (rad/s), once the parameters are known."""

        self.report = Reporter(node, robot.clock.now_ns, lambda text: note(f"{robot.name}: {text}"))
        self._read_only = settings.read_only
        self._services = RobotServices(node, robot, self.is_ready, read_only=self._read_only)
        self._parameters = ParameterServices(
            node,
            robot,
            self.clock.now,
            lambda: self.clock.is_simulated,
            read_only=self._read_only,
        )
        self.velocity = VelocityCommands(robot, self.clock, self.report, lambda: self.limits)
        self.navigation: Navigation | None = None
        self.graph = RosGraph(session, self._note_appeared, self._note_gone)
        if not self._read_only:
            self._take_commands()
        self._reader = telemetry.WheelReader()
        self._wheels: telemetry.WheelState | None = None
        self._odom = node.publisher("odom", "nav_msgs/msg/Odometry")
        self._tf = node.publisher("tf", "tf2_msgs/msg/TFMessage", TF)
        self._tf_static = node.publisher("tf_static", "tf2_msgs/msg/TFMessage", LATCHED)
        self._ranges = [
            node.publisher(frame, "sensor_msgs/msg/Range", SENSOR_DATA)
            for frame in telemetry.SONAR_FRAMES
        ]
        self._scan = None
        if settings.scan:
            self._scan = node.publisher("scan", "sensor_msgs/msg/LaserScan", SENSOR_DATA)
        self._joints = node.publisher("joint_states", "sensor_msgs/msg/JointState")
        self._description = node.publisher("robot_description", "std_msgs/msg/String", LATCHED)
        self._plan = node.publisher("plan", "nav_msgs/msg/Path")
        self._markers = node.publisher("markers", "visualization_msgs/msg/MarkerArray")
        self._clock_out = node.publisher(
            "/clock", "rosgraph_msgs/msg/Clock", Qos(depth=1, is_reliable=False)
        )

    def _take_commands(self) -> None:
        node, velocity = self.node, self.velocity
        node.subscribe("cmd_vel", "geometry_msgs/msg/Twist", velocity.take)
        node.subscribe("cmd_vel", "geometry_msgs/msg/TwistStamped", velocity.take_stamped)
        self.navigation = Navigation(node, self.robot, self.clock, self.report)

    def _note_appeared(self, parts: TokenParts, _gid: bytes) -> None:
        """Warn of nodes with which the robot cannot exchange data, and of a second gateway."""
        own = f"{self.node.name.namespace}/{NODE}"
        if parts.type_hash == NO_HASHES:
            self.report.warn_once(f"{parts.node} is a node of Humble. {HUMBLE}")
        elif parts.kind is EntityKind.NODE and parts.node == own:
            self.report.warn_once(f"another process presents {own}: its topics and ours mix")

    def _note_gone(self, parts: TokenParts, gid: bytes) -> None:
        """Cancel the goals of a client that has left the network."""
        if self.navigation is not None:
            for server in self.navigation.servers:
                server.note_gone(parts, gid)

    def is_ready(self) -> bool:
        """Return whether fresh telemetry of the robot arrives, with its pose."""
        now_ns = self.robot.clock.now_ns()
        newest = (self.robot.streams.latest(topic) for topic in (STATUS, ODOMETRY))
        return all(one is not None and now_ns - one[1] < SILENT_NS for one in newest)

    async def run(self) -> None:
        """Present the robot until this is cancelled."""
        self.report.log(INFO, f"{self.robot.name} is here")
        try:
            async with asyncio.TaskGroup() as tasks:
                for work in self._works():
                    tasks.create_task(work)
        finally:
            await finish(self._end_drives())

    async def _end_drives(self) -> None:
        await self.velocity.end()
        if self.navigation is not None:
            await self.navigation.end()

    def _works(self) -> list[Coroutine[Any, Any, None]]:
        return [
            self._follow_odometry(),
            self._follow_sonar(),
            self._follow_wheels(),
            self._follow_clock(),
            self._follow_texts(),
            self._follow_parameters(),
            self._diagnose(),
            self._draw(),
        ]

    def stamp(self, stamp_ns: int) -> int:
        """Return the time of ROS for a message of the robot that has just arrived."""
        self.clock.note(stamp_ns, time.time_ns())
        return self.clock.of(stamp_ns)

    async def _follow_odometry(self) -> None:
        async for pose in self.robot.stream(ODOMETRY):
            stamp_ns = self.stamp(pose.time_ns)
            self._odom.publish(telemetry.odometry(pose, stamp_ns))
            found = [telemetry.base_transform(pose, stamp_ns)]
            if self._wheels is not None:
                found += telemetry.wheel_transforms(self._wheels, self.geometry)
            self._tf.publish(telemetry.transforms(found))

    async def _follow_sonar(self) -> None:
        async for scan in self.robot.stream(SONAR):
            stamp_ns = self.stamp(scan.time_ns)
            for sonar, found in telemetry.ranges(scan, self.geometry, stamp_ns):
                self._ranges[sonar].publish(found)
            if self._scan is not None:
                self._scan.publish(telemetry.laser_scan(scan, self.geometry, stamp_ns))

    async def _follow_wheels(self) -> None:
        async for wheels in self.robot.stream(WHEELS):
            state = self._reader.read(wheels, self.geometry, self.stamp(wheels.time_ns))
            self._joints.publish(telemetry.joint_states(state))
            self._wheels = state

    async def _follow_clock(self) -> None:
        """Publish the time of a simulation; a robot without one sends none."""
        async for now in self.robot.stream(CLOCK):
            self.clock.is_simulated = True
            self._clock_out.publish(ClockMessage(telemetry.time_of(now.time_unix_usec * NS_PER_US)))

    async def _follow_parameters(self) -> None:
        """Publish what follows from the robot's dimensions, again when they have changed."""
        shown: telemetry.Geometry | None = None
        while True:
            try:
                values = {
                    name: one.value for name, one in (await self._parameters.refresh()).items()
                }
            except RemoteError:
                values = {}
            if values:
                self.limits = values.get("v_max_m_s", 0.0), values.get("yaw_max_rad_s", 0.0)
                geometry = telemetry.Geometry.of(values)
                if geometry != shown:
                    shown = self.geometry = geometry
                    self._show_geometry()
            await asyncio.sleep(PARAMETERS_S)

    async def _follow_texts(self) -> None:
        """Log the robot's own texts."""
        assembler = StatustextAssembler()
        async for piece in self.robot.stream(TEXT):
            if text := assembler.receive(piece):
                self.report.log(level_of(piece.severity), text)

    async def _diagnose(self) -> None:
        """Publish the state of the robot once a second."""
        while True:
            await asyncio.sleep(1.0)
            now_ns, latest = self.robot.clock.now_ns(), self.robot.streams.latest
            is_fresh = self.is_ready()
            status, pose, lease = latest(STATUS), latest(ODOMETRY), latest(LEASE)
            robot = self.report.vehicle(
                status[0] if status and is_fresh else None,
                pose[0] if pose else None,
                lease[0] if lease else None,
            )
            rejected = self.node.session.rejected
            text = f"{rejected} malformed messages dropped" if rejected else "ok"
            link = self.report.part(0, "ros2", text, rejected=rejected)
            self.report.diagnose(robot, self.velocity.part(now_ns), link)

    async def _draw(self) -> None:
        """Publish what the robot intends, if a node wants to see it."""
        robot, shown = self.robot, [(0.0, 0.0)]
        robot.streams.keep(DECISION)
        while True:
            await asyncio.sleep(DRAW_S)
            latest = robot.streams.latest
            pose, status, scan = latest(ODOMETRY), latest(STATUS), latest(SONAR)
            if pose is None or status is None or not self.is_ready():
                continue
            decision = latest(DECISION)
            chosen, stamp_ns = decision and decision[0], self.clock.of(pose[0].time_ns)
            places = drawing.places_of(pose[0], status[0], chosen)
            if places or shown:
                self._plan.publish(drawing.plan(places, stamp_ns))
            shown = places
            if self._markers.is_wanted:
                found = (pose[0], places, chosen, scan and scan[0], self.geometry, stamp_ns)
                self._markers.publish(drawing.markers(*found))

    def _show_geometry(self) -> None:
        self._tf_static.publish(telemetry.static_transforms(self.geometry, 0))
        self._description.publish(String(telemetry.urdf(self.robot.name, self.geometry)))


async def present(
    link: RobotLink,
    session: RosSession,
    settings: Mapping[str, FaceSettings],
    note: Callable[[str], None],
) -> None:
    """Present robots until this is cancelled; then their drives end, and the nodes leave."""
    async with AsyncExitStack() as stack:
        stack.push_async_callback(asyncio.to_thread, session.close)
        faces = []
        for name, one in settings.items():
            common = replace(link.common, robot=name)
            robot = Robot(link.bus, common, OPERATOR, clock=link.clock)
            stack.push_async_callback(closed, robot)
            await robot.open()
            faces.append(RobotFace(robot, session, one, note))
        session.start()
        async with asyncio.TaskGroup() as tasks:
            for face in faces:
                tasks.create_task(face.run())


async def closed(robot: Robot) -> None:
    """End the drives of a robot, also while this is cancelled."""
    await finish(robot.close())
