"""The judge of a robot on a ROS 2 network: one verdict for each row of what tools expect.

It reads what was observed of one robot, and does no I/O. The rows follow REP 103 (units and axes),
REP 105 (frames), REP 117 (ranges) and what rviz2, Nav2 and the `ros2` command line ask of a robot.
"""

from bisect import bisect_right
from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from itertools import pairwise
from math import cos, hypot, inf, isfinite, isnan, remainder, sin, tau
from typing import Any, Final, NamedTuple
from xml.etree import ElementTree

from gateways.ros2.wire import (
    NO_HASHES,
    Attachment,
    Distro,
    EntityKind,
    TokenParts,
    hash_of,
    type_of,
)
from protocol.ros_bag import yaw_of
from runtime.units import NS_PER_S

ODOMETRY: Final = "nav_msgs/msg/Odometry"
TF: Final = "tf2_msgs/msg/TFMessage"
RANGE: Final = "sensor_msgs/msg/Range"
SCAN: Final = "sensor_msgs/msg/LaserScan"
JOINTS: Final = "sensor_msgs/msg/JointState"
STRING: Final = "std_msgs/msg/String"
CLOCK: Final = "rosgraph_msgs/msg/Clock"
DIAGNOSTICS: Final = "diagnostic_msgs/msg/DiagnosticArray"
LOG: Final = "rcl_interfaces/msg/Log"
WATCHED: Final = (ODOMETRY, TF, RANGE, SCAN, JOINTS, STRING, CLOCK, DIAGNOSTICS)
"""The types of the topics that are received."""

PARAMETER_SERVICES: Final = (
    *("describe_parameters", "get_parameters", "get_parameter_types", "list_parameters"),
    *("set_parameters", "set_parameters_atomically"),
)
TWISTS: Final = ("geometry_msgs/msg/Twist", "geometry_msgs/msg/TwistStamped")
TRIGGER: Final = "std_srvs/srv/Trigger"
NAVIGATE: Final = "nav2_msgs/action/NavigateToPose"

BASES: Final = ("base_link", "base_footprint")
ODOMETRY_HZ: Final = 5.0
"""Least rate of odometry and transforms: costmaps and followers of paths become jerky below."""

OLD_S: Final = 0.5
EARLY_S: Final = 0.15
"""Greatest age of a stamp, and how far it may be ahead: of a simulated time it is some ticks."""

MOVED_M: Final = 0.1
TURNED_RAD: Final = 0.2
SHARE: Final = 0.2
"""From which way and turn on velocities are compared with poses, and how they may differ."""

NORM: Final = 1e-3


class Verdict(StrEnum):
    """What the judge has found for a row."""

    PASS = "pass"
    FAIL = "fail"
    ABSENT = "not offered"
    UNTRIED = "not tried"


class Finding(NamedTuple):
    """A verdict, and what was seen."""

    verdict: Verdict
    evidence: str


class Sample(NamedTuple):
    """A message, what came beside it, and when it arrived (ns, time of day)."""

    message: Any
    attachment: Attachment
    arrived_ns: int


@dataclass
class TopicSeen:
    """What has arrived of a topic, and how many samples were malformed."""

    name: str
    type_name: str
    samples: list[Sample] = field(default_factory=list)
    malformed: int = 0

    @property
    def messages(self) -> list[Any]:
        """The messages, in the order of their arrival."""
        return [one.message for one in self.samples]


@dataclass
class RobotSeen:
    """What was observed of one robot: the entities of its namespace, and samples for some time."""

    namespace: str
    seconds: float
    entities: dict[bytes, TokenParts]
    topics: list[TopicSeen]
    parameters: list[str] | None = None
    """The names that its service lists; None if none has answered."""

    state: str | None = None
    """The label of the state of its navigator; None without an answer."""

    def of(self, kind: EntityKind) -> dict[str, list[TokenParts]]:
        """Return the entities of a kind by their topic."""
        found: dict[str, list[TokenParts]] = defaultdict(list)
        for parts in self.entities.values():
            if parts.kind is kind:
                found[parts.topic].append(parts)
        return found

    def typed(self, *types: str) -> list[TopicSeen]:
        """Return the topics of these types."""
        return [one for one in self.topics if one.type_name in types]

    def offers(self, kind: EntityKind, last_part: str, *types: str) -> list[str]:
        """Return topics or services of these types whose name ends with these words."""
        return sorted(
            topic
            for topic, found in self.of(kind).items()
            if topic.endswith(f"/{last_part}")
            and any(type_of(one.type_in_key) in types for one in found)
        )

    @property
    def odometry(self) -> list[Any]:
        """The odometry that has arrived."""
        return [one for topic in self.typed(ODOMETRY) for one in topic.messages]

    @property
    def transforms(self) -> list[Any]:
        """All transforms that have arrived."""
        return [
            one for topic in self.typed(TF) for found in topic.messages for one in found.transforms
        ]


def passed(evidence: str) -> Finding:
    """Return that a row passes."""
    return Finding(Verdict.PASS, evidence)


def failed(evidence: str) -> Finding:
    """Return that a row fails."""
    return Finding(Verdict.FAIL, evidence)


def absent(evidence: str) -> Finding:
    """Return that a robot does not offer what a row is about, which is no failure."""
    return Finding(Verdict.ABSENT, evidence)


def untried(evidence: str) -> Finding:
    """Return that a row could not be judged."""
    return Finding(Verdict.UNTRIED, evidence)


def verdict_of(faults: Iterable[str], evidence: str) -> Finding:
    """Return that a row fails with its first faults, or passes."""
    found = list(dict.fromkeys(faults))
    if not found:
        return passed(evidence)
    more = f"; {len(found) - 3} more" if len(found) > 3 else ""
    return failed("; ".join(found[:3]) + more)


def seconds_of(stamp: Any) -> float:
    """Return a time of ROS in seconds."""
    return float(stamp.sec + stamp.nanosec / NS_PER_S)


def rate_hz(topic: TopicSeen) -> float:
    """Return the rate of a topic, by the times of its arrival."""
    times = [one.arrived_ns for one in topic.samples]
    if len(times) < 2 or times[-1] <= times[0]:
        return 0.0
    return (len(times) - 1) * NS_PER_S / (times[-1] - times[0])


# Rows.


def nodes(robot: RobotSeen) -> Finding:
    """Judge the names of the nodes."""
    names = Counter(one.node for one in robot.entities.values() if one.kind is EntityKind.NODE)
    faults = [f"{count} nodes have the name {name}" for name, count in names.items() if count > 1]
    return verdict_of(faults, ", ".join(sorted(names)) or "endpoints without a node")


def hashes(robot: RobotSeen) -> Finding:
    """Judge the type hashes, without which no data are exchanged."""
    faults, known = [], set()
    for one in robot.entities.values():
        if one.kind is EntityKind.NODE:
            continue
        if one.type_hash == NO_HASHES:
            faults.append(f"{one.topic}: no hash, as in Humble")
            continue
        name = type_of(one.type_in_key)
        expected = {found for distro in Distro if (found := hash_of_or_none(name, distro))}
        if expected:
            known.add(name)
            if one.type_hash not in expected:
                faults.append(f"{one.topic}: not the hash of {name}")
    return verdict_of(faults, f"{len(known)} types")


def hash_of_or_none(name: str, distro: Distro) -> str | None:
    """Return the hash of a type; None for one that is not in the table."""
    try:
        return hash_of(name, distro)
    except KeyError:
        return None


def attachments(robot: RobotSeen) -> Finding:
    """Judge what comes beside each sample; a node of ROS drops one without it."""
    faults, count = [], 0
    for topic in robot.topics:
        if topic.malformed:
            faults.append(f"{topic.name}: {topic.malformed} samples malformed")
        by_gid: dict[bytes, list[int]] = defaultdict(list)
        for one in topic.samples:
            by_gid[one.attachment.gid].append(one.attachment.sequence)
            count += 1
        for gid, numbers in by_gid.items():
            publisher = robot.entities.get(gid)
            if publisher is None or publisher.topic != topic.name:
                faults.append(f"{topic.name}: a sample names no publisher of this topic")
            if any(later <= earlier for earlier, later in pairwise(numbers)):
                faults.append(f"{topic.name}: sequence numbers do not grow")
    return verdict_of(faults, f"{count} samples")


def odometry(robot: RobotSeen) -> Finding:
    """Judge rate, frames and values of the odometry."""
    topics = robot.typed(ODOMETRY)
    if not topics:
        return failed("no nav_msgs/Odometry is published")
    faults = []
    for topic in topics:
        if rate_hz(topic) < ODOMETRY_HZ:
            faults.append(f"{topic.name}: {rate_hz(topic):.1f} Hz, at least {ODOMETRY_HZ:g}")
        for one in topic.messages:
            if one.header.frame_id not in ("odom", "map") or one.child_frame_id not in BASES:
                frames = f"{one.header.frame_id!r} -> {one.child_frame_id!r}"
                faults.append(f"{topic.name}: {frames} instead of odom -> base_link (REP 105)")
            faults += [f"{topic.name}: {why}" for why in faults_of_pose(one.pose.pose)]
            numbers = one.pose.covariance.reshape(6, 6)
            if not (numbers.diagonal() >= 0).all() or not numbers.any():
                faults.append(f"{topic.name}: the covariance has no or a negative variance")
            elif abs(numbers - numbers.T).max() > 1e-6:
                faults.append(f"{topic.name}: the covariance is not symmetric")
    return verdict_of(faults, ", ".join(f"{one.name} {rate_hz(one):.1f} Hz" for one in topics))


def faults_of_pose(pose: Any) -> list[str]:
    """Return what is wrong with a pose."""
    where, turned = pose.position, pose.orientation
    if not all(map(isfinite, (where.x, where.y, where.z))):
        return ["the position is not finite"]
    norm = hypot(turned.x, turned.y, turned.z, turned.w)
    return [] if abs(norm - 1) < NORM else [f"the quaternion has the length {norm:.3g}, not 1"]


def axes(robot: RobotSeen) -> Finding:
    """Judge by its way that x points forward and turns count to the left, in m and rad."""
    found = robot.odometry
    if len(found) < 2:
        return untried("no odometry")
    way_m = turn_rad = moved_m = turned_rad = 0.0
    for before, after in pairwise(found):
        passed_s = seconds_of(after.header.stamp) - seconds_of(before.header.stamp)
        yaws = [yaw_of(one.pose.pose.orientation) for one in (before, after)]
        if not 0 < passed_s < 1 or yaws[0] is None or yaws[1] is None:
            continue
        from_m, to_m = before.pose.pose.position, after.pose.pose.position
        ahead_rad = yaws[0] + remainder(yaws[1] - yaws[0], tau) / 2
        moved_m += (to_m.x - from_m.x) * cos(ahead_rad) + (to_m.y - from_m.y) * sin(ahead_rad)
        turned_rad += remainder(yaws[1] - yaws[0], tau)
        way_m += (before.twist.twist.linear.x + after.twist.twist.linear.x) / 2 * passed_s
        turn_rad += (before.twist.twist.angular.z + after.twist.twist.angular.z) / 2 * passed_s
    if max(abs(way_m), abs(moved_m)) < MOVED_M and max(abs(turn_rad), abs(turned_rad)) < TURNED_RAD:
        return untried("the robot has not moved: drive it while it is checked")
    faults = []
    if abs(way_m - moved_m) > SHARE * abs(moved_m) + MOVED_M / 2:
        faults.append(f"twist.linear.x gives {way_m:.2f} m, the poses {moved_m:.2f} m ahead")
    if abs(turn_rad - turned_rad) > SHARE * abs(turned_rad) + TURNED_RAD / 2:
        faults.append(f"twist.angular.z gives {turn_rad:.2f} rad, the poses {turned_rad:.2f} rad")
    return verdict_of(faults, f"{moved_m:.2f} m ahead, {turned_rad:.2f} rad to the left")


def tree(robot: RobotSeen) -> Finding:
    """Judge that the transforms form one tree, with the frames of the odometry."""
    topics = robot.typed(TF)
    if not topics:
        return failed("no tf2_msgs/TFMessage is published")
    faults, parents = [], defaultdict(set)
    for one in robot.transforms:
        parents[one.child_frame_id].add(one.header.frame_id)
        norm = hypot(*(getattr(one.transform.rotation, axis) for axis in "xyzw"))
        if abs(norm - 1) > NORM:
            faults.append(f"{one.child_frame_id}: the quaternion has the length {norm:.3g}, not 1")
    for child, found in parents.items():
        if len(found) > 1:
            faults.append(f"{child} has the parents {' and '.join(sorted(found))}")
    roots = {top for child in parents if (top := root_of(child, parents)) is not None}
    if len(roots) > 1:
        faults.append(f"several trees, from {', '.join(sorted(roots))}")
    if not roots:
        faults.append("no tree: a ring of frames" if parents else "no transform has arrived")
    wanted = {name for one in robot.odometry for name in (one.header.frame_id, one.child_frame_id)}
    frames = frames_of(robot)
    faults += [f"no frame {name}, which odometry names" for name in sorted(wanted - frames)]
    rates = [f"{one.name} {rate_hz(one):.1f} Hz" for one in topics if len(one.samples) > 2]
    return verdict_of(faults, ", ".join([f"{len(frames)} frames", *rates]))


def root_of(frame: str, parents: dict[str, set[str]]) -> str | None:
    """Return the first ancestor of a frame; None for a ring."""
    seen = set()
    while frame in parents:
        if frame in seen:
            return None
        seen.add(frame)
        frame = min(parents[frame])
    return frame


def frames_of(robot: RobotSeen) -> set[str]:
    """Return all frames of the transforms."""
    return {name for one in robot.transforms for name in (one.header.frame_id, one.child_frame_id)}


def stamps(robot: RobotSeen) -> Finding:
    """Judge the age of the stamps, by the time of a simulation if there is one."""
    faults, oldest = [], []
    for topic in robot.typed(ODOMETRY, RANGE, SCAN, JOINTS):
        if ages := ages_s(robot, topic):
            oldest.append(max(ages))
            if max(ages) > OLD_S or min(ages) < -EARLY_S:
                faults.append(f"{topic.name}: {min(ages):.2f} to {max(ages):.2f} s old on arrival")
    if not oldest:
        return untried("no stamps have arrived")
    return verdict_of(faults, f"{1000 * max(oldest):.0f} ms old at most")


def ages_s(robot: RobotSeen, topic: TopicSeen) -> list[float]:
    """Return how old the stamps of a topic were when they arrived; nothing without stamps."""
    if topic.type_name not in (ODOMETRY, RANGE, SCAN, JOINTS):
        return []
    clock = sorted(
        (one.arrived_ns, seconds_of(one.message.clock))
        for other in robot.typed(CLOCK)
        for one in other.samples
    )
    found = []
    for one in topic.samples:
        now_s = one.arrived_ns / NS_PER_S
        if clock:  # a simulation may be faster or slower than this computer's time
            known = bisect_right(clock, (one.arrived_ns, inf))
            if not known:
                continue
            now_s = clock[known - 1][1]
        found.append(now_s - seconds_of(one.message.header.stamp))
    return found


def ranges(robot: RobotSeen) -> Finding:
    """Judge the range sensors: frames, limits, and REP 117 for what was not measured."""
    topics = robot.typed(RANGE, SCAN)
    if not topics:
        return absent("neither sensor_msgs/Range nor LaserScan")
    faults, frames, rates = [], frames_of(robot), []
    for topic in topics:
        rates.append(rate_hz(topic))
        for one in topic.messages:
            name = f"{topic.name}: "
            is_scan = topic.type_name == SCAN
            limits = (one.range_min, one.range_max) if is_scan else (one.min_range, one.max_range)
            values = one.ranges.tolist() if is_scan else [one.range]
            if one.header.frame_id not in frames:
                faults.append(f"{name}no transform to its frame {one.header.frame_id!r}")
            if not 0 <= limits[0] < limits[1]:
                faults.append(f"{name}limits {limits[0]:g} to {limits[1]:g} m")
            elif any(isfinite(value) and not limits[0] <= value <= limits[1] for value in values):
                faults.append(f"{name}a value out of its limits, instead of infinite (REP 117)")
            if is_scan:
                width_rad = one.angle_max - one.angle_min
                count = 1 + width_rad / one.angle_increment if one.angle_increment else 0
                if abs(count - len(values)) > 1:
                    faults.append(f"{name}{len(values)} ranges, and angles for {count:.0f}")
            elif any(map(isnan, values)):
                faults.append(f"{name}a range that is not a number, instead of infinite (REP 117)")
    silent = [topic.name for topic in topics if not topic.samples]
    faults += [f"{name}: no sample" for name in silent]
    return verdict_of(faults, f"{len(topics)} topics, {min(rates):.1f} to {max(rates):.1f} Hz")


def joints(robot: RobotSeen) -> Finding:
    """Judge the joint states: lengths, and velocities that give the positions."""
    topics = robot.typed(JOINTS)
    if not topics:
        return absent("no sensor_msgs/JointState")
    faults = []
    for topic in topics:
        for one in topic.messages:
            lengths = {len(values) for values in (one.position, one.velocity) if len(values)}
            if lengths - {len(one.name)}:
                faults.append(f"{topic.name}: {len(one.name)} names, but {lengths} values")
        for before, after in pairwise(topic.messages):
            passed_s = seconds_of(after.header.stamp) - seconds_of(before.header.stamp)
            both = (before.position, after.position, after.velocity)
            if 0 < passed_s < 1 and len({len(values) for values in both}) == 1 and len(both[0]):
                speeds = (after.position - before.position) / passed_s
                if abs(speeds - after.velocity).max() > 1 + SHARE * abs(speeds).max():
                    faults.append(
                        f"{topic.name}: velocities are not those of the positions (rad/s)"
                    )
    return verdict_of(faults, ", ".join(f"{one.name} {rate_hz(one):.1f} Hz" for one in topics))


def description(robot: RobotSeen) -> Finding:
    """Judge the URDF: latched, XML, and links that are frames."""
    texts = [
        one.data
        for topic in robot.typed(STRING)
        if topic.name.endswith("/robot_description")
        for one in topic.messages
    ]
    if not robot.offers(EntityKind.PUBLISHER, "robot_description", STRING):
        return absent("no robot_description")
    if not texts:
        return failed("a late joiner gets none: it must be latched")
    if "<!DOCTYPE" in texts[-1] or "<!ENTITY" in texts[-1]:
        return failed("it declares a type or entities")
    try:
        found = ElementTree.fromstring(texts[-1])
    except ElementTree.ParseError as error:
        return failed(f"it is no XML: {error}")
    links = {str(one.get("name")) for one in found.iter("link")}
    faults = [] if links else ["it has no links"]
    faults += [f"no transform to its link {one}" for one in sorted(links - frames_of(robot))]
    return verdict_of(faults, f"{len(links)} links")


def clock(robot: RobotSeen) -> Finding:
    """Judge the time of a simulation."""
    topics = [one for one in robot.typed(CLOCK) if one.samples]
    if not topics:
        return absent("no /clock: stamps have the time of day")
    times = [seconds_of(one.clock) for topic in topics for one in topic.messages]
    faults = [] if times == sorted(times) else ["it goes back"]
    return verdict_of(faults, f"{rate_hz(topics[0]):.1f} Hz, now {times[-1]:.1f} s")


def velocity(robot: RobotSeen) -> Finding:
    """Judge that commands of speed are taken."""
    found = robot.offers(EntityKind.SUBSCRIBER, "cmd_vel", *TWISTS)
    if not found:
        return absent("no subscriber of cmd_vel: nothing drives it by hand")
    subscribers = robot.of(EntityKind.SUBSCRIBER)
    types = {type_of(one.type_in_key) for name in found for one in subscribers[name]}
    taken = {name.rpartition("/")[2] for name in types & set(TWISTS)}
    return passed(f"{', '.join(found)}: {' and '.join(sorted(taken))}")


def words(robot: RobotSeen) -> Finding:
    """Judge diagnostics and logs."""
    found = [one for one in robot.typed(DIAGNOSTICS) if one.samples]
    has_log = robot.offers(EntityKind.PUBLISHER, "rosout", LOG)
    if not found and not has_log:
        return absent("neither /diagnostics nor /rosout")
    levels = [part.level & 255 for topic in found for one in topic.messages for part in one.status]
    faults = ["a level that is none"] if any(not 0 <= level <= 3 for level in levels) else []
    worst = ("ok", "warnings", "errors", "stale")[max(levels, default=0) % 4]
    shown = [f"/diagnostics: {worst}"] if found else []
    return verdict_of(faults, ", ".join([*shown, *(["/rosout"] if has_log else [])]))


def parameters(robot: RobotSeen) -> Finding:
    """Judge the services of parameters: with five of the six `ros2 param list` times out."""
    services = robot.of(EntityKind.SERVER)
    by_node: dict[str, set[str]] = defaultdict(set)
    for topic in services:
        node, _, last = topic.rpartition("/")
        if last in PARAMETER_SERVICES:
            by_node[node].add(last)
    if not by_node:
        return absent("no services of parameters")
    faults = [
        f"{node}: no {', '.join(sorted(set(PARAMETER_SERVICES) - names))}"
        for node, names in by_node.items()
        if names != set(PARAMETER_SERVICES)
    ]
    if not faults and robot.parameters is None:
        faults.append("list_parameters does not answer")
    return verdict_of(faults, f"{len(robot.parameters or ())} parameters")


def stop(robot: RobotSeen) -> Finding:
    """Judge that there is a stop that any node may call; it is not called."""
    found = robot.offers(EntityKind.SERVER, "emergency_stop", TRIGGER)
    return passed(", ".join(found)) if found else absent("no service emergency_stop (Trigger)")


def navigation(robot: RobotSeen) -> Finding:
    """Judge the action of Nav2: three services and two topics."""
    kinds = {
        "send_goal": (EntityKind.SERVER, f"{NAVIGATE}_SendGoal"),
        "get_result": (EntityKind.SERVER, f"{NAVIGATE}_GetResult"),
        "cancel_goal": (EntityKind.SERVER, "action_msgs/srv/CancelGoal"),
        "feedback": (EntityKind.PUBLISHER, f"{NAVIGATE}_FeedbackMessage"),
        "status": (EntityKind.PUBLISHER, "action_msgs/msg/GoalStatusArray"),
    }
    there = {
        part
        for part, (kind, type_name) in kinds.items()
        if robot.offers(kind, f"navigate_to_pose/_action/{part}", type_name)
    }
    if not there:
        return absent("no action navigate_to_pose")
    missing = [part for part in kinds if part not in there]
    faults = [f"navigate_to_pose/_action without {', '.join(missing)}"] if missing else []
    return verdict_of(faults, "navigate_to_pose")


def lifecycle(robot: RobotSeen) -> Finding:
    """Judge that the simple commander of Nav2 goes on."""
    if not robot.offers(EntityKind.SERVER, "bt_navigator/get_state", "lifecycle_msgs/srv/GetState"):
        return absent("no bt_navigator/get_state: the simple commander waits for it")
    if robot.state is None:
        return failed("bt_navigator/get_state does not answer")
    return passed(f"bt_navigator is {robot.state}")


class JudgeRow(NamedTuple):
    """A row: its title, and its judgement."""

    title: str
    judge: Callable[[RobotSeen], Finding]


ROWS: Final[Sequence[JudgeRow]] = (
    JudgeRow("nodes with names of their own", nodes),
    JudgeRow("type hashes are those of ROS", hashes),
    JudgeRow("each sample has its attachment", attachments),
    JudgeRow("odometry: rate, frames, covariance", odometry),
    JudgeRow("x forward, turns to the left, m and rad (REP 103)", axes),
    JudgeRow("transforms are one tree (REP 105)", tree),
    JudgeRow("stamps are of the measurement, and fresh", stamps),
    JudgeRow("range sensors (REP 117)", ranges),
    JudgeRow("joint states", joints),
    JudgeRow("robot_description is latched URDF", description),
    JudgeRow("/clock of a simulation", clock),
    JudgeRow("cmd_vel is taken", velocity),
    JudgeRow("/diagnostics and /rosout", words),
    JudgeRow("six services of parameters", parameters),
    JudgeRow("emergency_stop", stop),
    JudgeRow("action navigate_to_pose", navigation),
    JudgeRow("state of the navigator", lifecycle),
)


def judged(robot: RobotSeen) -> list[tuple[JudgeRow, Finding]]:
    """Judge all rows of a robot. What arrives may be anything: a row that cannot be read fails."""
    found = []
    for row in ROWS:
        try:
            found.append((row, row.judge(robot)))
        except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError) as error:
            found.append((row, failed(f"unusable values: {type(error).__name__}: {error}")))
    return found
