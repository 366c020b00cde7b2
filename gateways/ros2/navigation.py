"""The goals of ROS 2: the actions NavigateToPose and FollowWaypoints, /goal_pose, /initialpose.

A robot drives to one place at a time, so a new goal ends the one before, whichever way it came.
Results have the numbers that Nav2 gives its errors, and the robot's own reason as their text.
"""

import asyncio
from collections.abc import Awaitable, Callable, Sequence
from functools import partial
from math import degrees, hypot, isfinite, pi
from typing import Any, Final, NamedTuple

from gateways.ros2.actions import ABORTED, SUCCEEDED, ActionServer, Build, Feedback
from gateways.ros2.interfaces import Interfaces
from gateways.ros2.node import RosNode
from gateways.ros2.report import Reporter
from gateways.ros2.wire import Attachment, Distro
from ground.client.goal import (
    HEADING_TOLERANCE_DEG,
    POSITION_TOLERANCE_M,
    Destination,
    destination,
    from_robot,
)
from ground.client.outcomes import GoalEnded, Refused
from ground.client.robot_link import finish
from ground.robot import Robot
from ground.ros2.messages import BASE, MAP, ODOM, RosClock, pose_stamped, time_of
from ground.ros2.reports import INFO
from protocol.outcome import LOST, REPLACED, UNREACHABLE
from protocol.ros_bag import yaw_of
from protocol.topics import ODOMETRY, STATUS
from protocol.wire.reasons import Reason
from runtime.errors import LocalError, RemoteError, UserError
from runtime.units import NS_PER_S

NAVIGATE: Final = "nav2_msgs/action/NavigateToPose"
FOLLOW: Final = "nav2_msgs/action/FollowWaypoints"
FRAMES: Final = ("", MAP, ODOM, BASE)
FEEDBACK_S: Final = 0.5
STILL: Final = 1e-3
"""Speed (m/s) and turn (rad/s) of a robot that stands."""

STANDS_NS: Final = 2 * NS_PER_S
"""Longest wait for a cancelled robot to stand."""

NO_ERROR: Final = 0
REJECTED: Final = 1
FAILED: Final = 9000
TIMED_OUT: Final = 9003
NO_PROGRESS: Final = 105
NO_PATH: Final = 208
"""Error codes: of the navigator itself, of a controller that comes no closer, of a planner."""

ERRORS: Final = {
    UNREACHABLE: NO_PATH,
    LOST: NO_PATH,
    "stuck": NO_PROGRESS,
    "timeout": TIMED_OUT,
}
WAYPOINT_FAILED: Final = 3
MAX_WORKS: Final = 8
MAX_WAYPOINTS: Final = 1000
MAX_LOOPS: Final = 1000


def place_in(pose: Any) -> Destination:
    """Return the goal in a PoseStamped, as seen from its frame; UserError if there is none.

    A rotation of zeros means any heading.
    """
    where, rotation = pose.pose.position, pose.pose.orientation
    frame = pose.header.frame_id.strip("/")
    if frame not in FRAMES:
        known = ", ".join(FRAMES[1:])
        raise UserError(f"a goal in frame {frame!r}: the robot knows only {known}")
    if not (isfinite(where.x) and isfinite(where.y)):
        raise UserError("a goal needs finite numbers")
    numbers = [where.x, where.y]
    if any((rotation.x, rotation.y, rotation.z, rotation.w)):
        yaw_rad = yaw_of(rotation)
        if yaw_rad is None:
            raise UserError("the orientation of the goal is no rotation")
        numbers.append(degrees(yaw_rad))
    return destination(
        numbers,
        position_tolerance_m=POSITION_TOLERANCE_M,
        heading_tolerance_deg=HEADING_TOLERANCE_DEG,
    )


class Navigation:
    """Drives a robot to the goals of its clients."""

    def __init__(self, node: RosNode, robot: Robot, clock: RosClock, report: Reporter) -> None:
        self._robot, self._clock, self._report = robot, clock, report
        self._works: set[asyncio.Task[None]] = set()
        """What topics have asked for; a newer goal ends an older one."""

        self.navigate = ActionServer(
            node,
            "navigate_to_pose",
            NAVIGATE,
            self._refusing(lambda goal: place_in(goal.pose)),
            self._navigate,
            lambda text: navigated(FAILED, text),
            clock.now,
        )
        self.follow = ActionServer(
            node,
            "follow_waypoints",
            FOLLOW,
            self._refusing(self._check_waypoints),
            self._follow_waypoints,
            lambda text: followed([], FAILED, text),
            clock.now,
        )
        node.subscribe("goal_pose", "geometry_msgs/msg/PoseStamped", self._take_goal)
        node.subscribe(
            "initialpose", "geometry_msgs/msg/PoseWithCovarianceStamped", self._take_pose
        )

    @property
    def servers(self) -> tuple[ActionServer, ...]:
        """The actions."""
        return self.navigate, self.follow

    async def end(self) -> None:
        """Cancel all goals: the robot stops."""
        for work in tuple(self._works):
            work.cancel()
        await asyncio.gather(*self._works, return_exceptions=True)
        for server in self.servers:
            await server.end()

    def _refusing(self, check: Callable[[Any], object]) -> Callable[[Any], str]:
        """Return what logs why a goal is refused."""

        def refuse(goal: Any) -> str:
            try:
                check(goal)
            except UserError as error:
                self._report.warn_once(f"goal refused: {error}")
                return str(error)
            return ""

        return refuse

    # One goal.

    async def _drive(self, pose: Any) -> tuple[int, str]:
        """Drive to a pose; return the error code and the reason. Cancelled, the robot stops."""
        try:
            goal = place_in(pose)
            if pose.header.frame_id.strip("/") == BASE:
                here = await self._robot.pose()
                goal = from_robot(goal, here.x_m, here.y_m, here.heading_rad)
            ended = await self._robot.drive_to(goal)
        except asyncio.CancelledError:
            await finish(self._stand())
            raise
        except (LocalError, RemoteError) as error:
            return FAILED, str(error)
        return verdict_of(ended)

    async def _stand(self) -> None:
        """Wait until the robot stands, for a short time."""
        with self._robot.subscribed(ODOMETRY) as telemetry:

            def stands() -> bool:
                newest = telemetry.latest(ODOMETRY)
                if newest is None:
                    return False
                return max(abs(newest[0].speed_m_s), abs(newest[0].yaw_rate_rad_s)) < STILL

            await self._robot.wait(stands, STANDS_NS)

    async def _navigate(self, goal: Any, send: Feedback) -> tuple[int, Build]:
        telling = asyncio.get_running_loop().create_task(self._tell(goal.pose, send))
        try:
            code, text = await self._drive(goal.pose)
        finally:
            telling.cancel()
        return ABORTED if code else SUCCEEDED, navigated(code, text)

    async def _tell(self, target: Any, send: Feedback) -> None:
        """Send feedback while a goal is driven to."""
        began_ns = self._clock.now()
        while True:
            latest = self._robot.streams.latest
            pose, status = latest(ODOMETRY), latest(STATUS)
            if pose is not None and status is not None:
                now_ns, here = self._clock.now(), pose[0]
                where = target.pose.position
                straight_m = hypot(where.x - here.x_m, where.y - here.y_m)
                left_m = status[0].goal_distance_m
                left_m = left_m if isfinite(left_m) else straight_m
                left_s = left_m / here.speed_m_s if here.speed_m_s > 0.01 else 0.0
                send(feedback(here, now_ns, now_ns - began_ns, left_s, left_m))
            await asyncio.sleep(FEEDBACK_S)

    # Several goals.

    @staticmethod
    def _check_waypoints(goal: Any) -> None:
        if not 0 < len(goal.poses) <= MAX_WAYPOINTS:
            raise UserError(f"{len(goal.poses)} waypoints: use 1 to {MAX_WAYPOINTS}")
        if goal.goal_index >= len(goal.poses) or goal.number_of_loops > MAX_LOOPS:
            raise UserError("goal_index or number_of_loops is out of range")
        for pose in goal.poses:
            place_in(pose)

    async def _follow_waypoints(self, goal: Any, send: Feedback) -> tuple[int, Build]:
        """Drive to each waypoint; one that cannot be reached is missed, and the next one follows.

        What an operator has ended is not continued.
        """
        missed: list[Missed] = []
        for loop in range(goal.number_of_loops + 1):
            first = 0 if loop else goal.goal_index
            for index in range(first, len(goal.poses)):
                send(partial(current_waypoint, index))
                code, text = await self._drive(goal.poses[index])
                if code:
                    missed.append(Missed(index, goal.poses[index], code, text))
                if code not in (NO_ERROR, NO_PATH, NO_PROGRESS):
                    return ABORTED, followed(missed, FAILED, text)
        return SUCCEEDED, followed(missed, NO_ERROR, "")

    # Topics.

    def _take_goal(self, pose: Any, _attachment: Attachment) -> None:
        """Drive to a goal without a client that waits for its end."""
        if not self._refusing(place_in)(pose):
            self._begin("goal_pose", lambda: self._drive(pose))

    def _take_pose(self, message: Any, _attachment: Attachment) -> None:
        """Set the pose of the robot, as `pose set` does; refused while a goal is active."""
        where = message.pose.pose
        yaw_rad = yaw_of(where.orientation)
        frame = message.header.frame_id.strip("/")
        if yaw_rad is None or frame not in (MAP, ODOM) or abs(yaw_rad) > pi:
            self._report.warn_once("initialpose: refused, it is no pose in map")
            return
        x_m, y_m = where.position.x, where.position.y
        self._begin("initialpose", lambda: self._set_pose(x_m, y_m, degrees(yaw_rad)))

    def _begin(self, what: str, work: Callable[[], Awaitable[tuple[int, str]]]) -> None:
        """Begin what a topic asks for, unless too much of it has not ended."""
        if len(self._works) >= MAX_WORKS:
            self._report.warn_once(f"{what}: refused, too many at once")
            return
        task = asyncio.get_running_loop().create_task(self._logged(what, work))
        self._works.add(task)
        task.add_done_callback(self._works.discard)

    async def _set_pose(self, x_m: float, y_m: float, yaw_deg: float) -> tuple[int, str]:
        answer = await self._robot.set_pose(x_m, y_m, yaw_deg)
        return (REJECTED, answer.words) if isinstance(answer, Refused) else (NO_ERROR, "")

    async def _logged(self, what: str, work: Callable[[], Awaitable[tuple[int, str]]]) -> None:
        try:
            code, text = await work()
        except (LocalError, RemoteError) as error:
            code, text = FAILED, str(error)
        if code:
            self._report.warn_once(f"{what}: {text}")
        else:
            self._report.log(INFO, f"{what}: done")


def verdict_of(ended: GoalEnded | Refused) -> tuple[int, str]:
    """Return the error code of Nav2 for the end of a goal, and the reason."""
    if isinstance(ended, Refused):
        outside = (Reason.GOAL_OUT_OF_RANGE, Reason.OUTSIDE_FENCE)
        return (NO_PATH if ended.reason in outside else REJECTED), ended.words
    if ended.ok:
        return NO_ERROR, ""
    if ended.outcome == REPLACED:
        return FAILED, ended.text
    return ERRORS.get(ended.outcome, FAILED), ended.text


# Messages, as each distribution defines them.


class Missed(NamedTuple):
    """A waypoint that was not reached."""

    number: int
    pose: Any
    code: int
    text: str


def feedback(here: Any, now_ns: int, passed_ns: int, left_s: float, left_m: float) -> Build:
    """Return the feedback of a goal: where the robot is, and the time and way so far and left."""

    def build(interfaces: Interfaces) -> Any:
        duration = "builtin_interfaces/msg/Duration"
        passed, left = time_of(max(0, passed_ns)), time_of(round(left_s * NS_PER_S))
        fields: list[Any] = [
            pose_stamped(here, now_ns),
            interfaces.make(duration, passed.sec, passed.nanosec),
            interfaces.make(duration, left.sec, left.nanosec),
            0,
            left_m,
        ]
        if interfaces.distro is Distro.LYRICAL:
            fields += [0.0, 0.0]  # no planned path, so no distance from it
        return interfaces.make(f"{NAVIGATE}_Feedback", *fields)

    return build


def navigated(code: int, text: str) -> Build:
    """Return the result of a goal."""
    return lambda interfaces: interfaces.make(f"{NAVIGATE}_Result", code, text)


def current_waypoint(index: int, interfaces: Interfaces) -> Any:
    """Return the feedback of several goals."""
    return interfaces.make(f"{FOLLOW}_Feedback", index)


def followed(missed: Sequence[Missed], code: int, text: str) -> Build:
    """Return the result of several goals."""

    def build(interfaces: Interfaces) -> Any:
        if interfaces.distro is Distro.JAZZY:
            name = "nav2_msgs/msg/MissedWaypoint"
            found = [interfaces.make(name, one.number, one.pose, one.code) for one in missed]
        else:
            name = "nav2_msgs/msg/WaypointStatus"
            found = [interfaces.make(name, WAYPOINT_FAILED, *one) for one in missed]
        return interfaces.make(f"{FOLLOW}_Result", found, code, text)

    return build
