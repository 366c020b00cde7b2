"""What one robot offers as a ROS 2 node: its topics, services and parameters."""

import asyncio
import time
from collections.abc import Callable, Coroutine, Iterable, Mapping
from contextlib import AsyncExitStack
from dataclasses import dataclass, replace
from typing import Any, Final

from gateways.ros2.navigation import Navigation
from gateways.ros2.node import RosGraph, RosNode, RosSession
from gateways.ros2.parameters import ParameterServices
from gateways.ros2.report import Reporter
from gateways.ros2.services import RobotServices
from gateways.ros2.velocity import VelocityCommands
from gateways.ros2.wire import (
    HUMBLE,
    NO_HASHES,
    EntityKind,
    TokenParts,
)
from ground.client.robot_link import RobotLink, finish
from ground.robot import Robot
from ground.ros2.offer import NODE, topics
from ground.ros2.reports import INFO, level_of, robot_part
from ground.ros2.robot_topics import RobotTopics, Shown
from protocol.topics import CLOCK, DECISION, LEASE, ODOMETRY, SONAR, STATUS, TEXT, WHEELS, Topic
from protocol.wire.statustext import StatustextAssembler
from runtime.errors import RemoteError
from runtime.units import NS_PER_MS

OPERATOR: Final = "ros2"
"""The name that other operators see."""

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
        self.publishers = {
            name: node.publisher(topic.name, topic.type_name, topic.qos)
            for name, topic in topics(scan=settings.scan).items()
        }
        self.topics = RobotTopics(robot.name, scan=settings.scan)
        self.clock = self.topics.clock
        self.limits = (0.0, 0.0)
        """The fastest speed (m/s) and turn (rad/s), once the parameters are known."""

        self.report = Reporter(
            node, self.publishers, robot.clock.now_ns, lambda text: note(f"{robot.name}: {text}")
        )
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
            *map(self._follow, (ODOMETRY, SONAR, WHEELS, CLOCK)),
            self._follow_texts(),
            self._follow_parameters(),
            self._diagnose(),
            self._draw(),
        ]

    def publish(self, found: Iterable[Shown]) -> None:
        """Publish messages on their topics."""
        for name, message in found:
            self.publishers[name].publish(message)

    async def _follow(self, topic: Topic[Any]) -> None:
        """Publish what a topic of the robot says; a robot without a simulation sends no clock."""
        async for found in self.robot.stream(topic):
            self.publish(self.topics.take(found, time.time_ns()))

    async def _follow_parameters(self) -> None:
        """Publish what follows from the robot's dimensions, again when they have changed."""
        while True:
            try:
                values = {
                    name: one.value for name, one in (await self._parameters.refresh()).items()
                }
            except RemoteError:
                values = {}
            if values:
                self.limits = values.get("v_max_m_s", 0.0), values.get("yaw_max_rad_s", 0.0)
                self.publish(self.topics.shape(values))
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
            robot = robot_part(
                self.report.logger,
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
        latest = self.robot.streams.latest
        self.robot.streams.keep(DECISION)
        while True:
            await asyncio.sleep(DRAW_S)
            pose, status, scan = latest(ODOMETRY), latest(STATUS), latest(SONAR)
            if pose is None or status is None or not self.is_ready():
                continue
            decision = latest(DECISION)
            found = pose[0], status[0], decision and decision[0]
            self.publish(self.topics.plan(*found))
            if self.publishers["markers"].is_wanted:
                self.publish([self.topics.markers(*found, scan and scan[0])])


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
