"""Read bags of ROS 2: poses and ranges of robots, and maps, by the library rosbags.

A bag is a folder with a metadata.yaml, or one of its files (.mcap, .db3). Whatever is wrong with it
is a BagError. The library is that of the extra `ros2`, and only loaded to open a bag.
"""

import re
from collections.abc import Collection, Iterator
from contextlib import ExitStack, suppress
from math import inf, isfinite
from pathlib import Path
from typing import Any, Final, NamedTuple, Self

from protocol.topic import MAX_NAME
from runtime.elementary import atan2, cos_sin
from runtime.errors import UserError
from runtime.files import opened
from runtime.units import NS_PER_S

METADATA: Final = "metadata.yaml"
SUFFIXES: Final = (".mcap", ".db3")
ROS_MCAP: Final = re.compile(rb"\x89MCAP0\r\n\x01.{8}\x04\x00\x00\x00ros2", re.DOTALL)
HEAD_BYTES: Final = 25
ODOMETRY: Final = "nav_msgs/msg/Odometry"
GRID: Final = "nav_msgs/msg/OccupancyGrid"
RANGE: Final = "sensor_msgs/msg/Range"
SCAN: Final = "sensor_msgs/msg/LaserScan"
TRANSFORMS: Final = "tf2_msgs/msg/TFMessage"
MAX_MESSAGES: Final = 2_000_000
"""Of the topics that are read: those of a day at 20 Hz."""

MAX_LINKS: Final = 20
USUAL_ROBOT: Final = "r1"
NEEDS: Final = "a bag of ROS 2 needs {}, which is not installed"


class BagError(UserError):
    """A bag cannot be used; the text has the file, the reason and a fix."""

    def __init__(self, file: Path, reason: str, fix: str) -> None:
        super().__init__(f"{file}: {reason}: {fix}")
        self.file, self.reason, self.fix = file, reason, fix


def is_bag(path: Path) -> bool:
    """Return whether a path leads to a bag or a file of one, whole or not."""
    if path.is_dir():
        files = [one for one in path.iterdir() if one.suffix in SUFFIXES]
        return (path / METADATA).exists() or (bool(files) and all(map(is_bag, files)))
    if path.suffix == ".mcap":
        with suppress(OSError), opened(path) as source:
            return ROS_MCAP.match(source.read(HEAD_BYTES)) is not None
    return path.suffix == ".db3"


class BagMessage(NamedTuple):
    """A message, with its time in the bag in UTC."""

    topic: str
    time_ns: int
    content: Any


class RosBag:
    """An open bag; `types` has the type of each topic, `counts` the number of its messages."""

    def __init__(self, path: Path) -> None:
        """Open a bag; BagError if it cannot be read."""
        self.path = path
        self.unreadable = 0
        """Number of messages that are malformed."""

        self.read = 0
        """Number of messages that were read, and of those asked for."""
        self.asked = 0
        try:
            from rosbags.rosbag2 import Reader
            from rosbags.typesys import Stores, get_typestore
        except ModuleNotFoundError as error:
            reason = NEEDS.format(error.name)
            raise BagError(path, reason, "pip install 'sidestep[ros2]'") from None
        self._stores = [get_typestore(one) for one in (Stores.ROS2_JAZZY, Stores.ROS2_HUMBLE)]
        self._stack = ExitStack()
        try:
            self._reader: Any = self._stack.enter_context(Reader(path))
        except Exception as error:  # the library and its databases raise many
            raise self._refusal(error) from None
        self.types: dict[str, str] = {one.topic: one.msgtype for one in self._reader.connections}
        self.counts: dict[str, int] = {}
        for one in self._reader.connections:
            self.counts[one.topic] = self.counts.get(one.topic, 0) + one.msgcount

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    def _refusal(self, error: Exception) -> BagError:
        if not self.path.exists():
            return BagError(self.path, "there is no such file", "name a bag")
        if self.path.is_dir() and not (self.path / METADATA).exists():
            fix = "`ros2 bag reindex` writes it, or name the .mcap or .db3 file in the folder"
            return BagError(self.path, f"{METADATA} is missing", fix)
        words = (str(error).splitlines() or [type(error).__name__])[0].rstrip(".")
        if words.startswith("Profile is not"):
            fix = "if it is a recording of this project, `sidestep rec export --ros2` makes a bag"
            return BagError(self.path, "it is not of ROS 2", fix)
        fix = "if it was cut off, repair it with `mcap recover` or `ros2 bag reindex`"
        return BagError(self.path, f"it cannot be read ({words})", fix)

    def topics(self, *types: str) -> list[str]:
        """Return the topics of some types with messages, in order."""
        return sorted(
            name for name, one in self.types.items() if one in types and self.counts.get(name)
        )

    def require(self, what: str, fix: str, *types: str) -> list[str]:
        """Return the topics of some types; BagError if there is none."""
        if found := self.topics(*types):
            return found
        listed = ", ".join(f"{name} ({one})" for name, one in sorted(self.types.items())[:8])
        more = ", ..." if len(self.types) > 8 else ""
        raise BagError(self.path, f"it has no {what}, only {listed or 'nothing'}{more}", fix)

    def messages(self, names: Collection[str]) -> Iterator[BagMessage]:
        """Yield the readable messages of some topics in the order of time; BagError if damaged."""
        chosen = [one for one in self._reader.connections if one.topic in names]
        asked = sum(one.msgcount for one in chosen)
        self.asked += asked
        if asked > MAX_MESSAGES:
            reason = f"{asked} messages of {len(names)} topics, at most {MAX_MESSAGES}"
            raise BagError(self.path, reason, "cut it with `ros2 bag convert`")
        if not chosen:
            return
        try:
            for connection, time_ns, data in self._reader.messages(chosen):
                self.read += 1
                content = self._decoded(data, connection.msgtype)
                if content is None:
                    self.unreadable += 1
                else:
                    yield BagMessage(connection.topic, time_ns, content)
        except (GeneratorExit, BagError):
            raise
        except Exception as error:
            raise self._refusal(error) from None

    def _decoded(self, data: bytes, type_name: str) -> Any:
        """Return a message; None for malformed bytes. Humble's Range is shorter than later ones."""
        for store in self._stores:
            with suppress(Exception):
                return store.deserialize_cdr(data, type_name)
        return None


class Mount(NamedTuple):
    """The place of a frame on a robot, in the frame of its base."""

    x_m: float = 0.0
    y_m: float = 0.0
    yaw_rad: float = 0.0

    def of(self, inner: "Mount") -> "Mount":
        """Return the place of a frame that is placed in this one."""
        c, s = cos_sin(self.yaw_rad)
        x_m = self.x_m + c * inner.x_m - s * inner.y_m
        y_m = self.y_m + s * inner.x_m + c * inner.y_m
        return Mount(x_m, y_m, self.yaw_rad + inner.yaw_rad)


class BagPose(NamedTuple):
    """A pose with its upper triangle of covariances; it counts from the frame of the odometry."""

    time_ns: int
    stamp_ns: int
    x_m: float
    y_m: float
    heading_rad: float
    speed_m_s: float
    yaw_rate_rad_s: float
    covariance: tuple[float, ...]


class BagRays(NamedTuple):
    """Rays of a sensor at a place on the robot: bearings in its frame, and ranges; inf if free.

    Each ray is a cone of a width. A range that is not a number is left out.
    """

    time_ns: int
    stamp_ns: int
    sensor: str
    mount: Mount
    rays: tuple[tuple[float, float], ...]
    width_rad: float
    max_m: float


class BagRobot:
    """A robot of a bag: a topic of odometry, and those with ranges in its namespace."""

    def __init__(self, bag: RosBag, namespace: str) -> None:
        named = re.sub(r"[^a-z0-9_-]", "_", namespace.strip("/").lower())
        self.name = named[:MAX_NAME] or USUAL_ROBOT
        self.left_out: set[str] = set()
        """Frames of sensors whose place on the robot is unknown."""

        self.far_m = 0.0
        """The largest range of its sensors so far."""

        self._bag, self.namespace = bag, namespace
        own = [name for name in bag.topics(ODOMETRY) if namespace_of(name) == namespace]
        self.odometry = next((one for one in own if one.endswith("/odom")), own[0])
        self.ranges = [name for name in bag.topics(RANGE, SCAN) if name.startswith(f"{namespace}/")]
        self._mounts: dict[str, Mount | None] = {}
        self._links: dict[str, tuple[str, Mount]] = {}
        self._base: str | None = None

    def events(self) -> Iterator[BagPose | BagRays]:
        """Yield poses and ranges in the order of time; BagError if the bag is damaged."""
        self._read_links()
        for topic, time_ns, content in self._bag.messages({self.odometry, *self.ranges}):
            if topic == self.odometry:
                if self._base is None:
                    self._base = content.child_frame_id
                    self._mounts.clear()
                if (pose := pose_in(content, time_ns)) is not None:
                    yield pose
                else:
                    self._bag.unreadable += 1
            elif (mount := self._mount(content.header.frame_id)) is None:
                self.left_out.add(content.header.frame_id)
            elif rays := rays_in(content, time_ns, mount):
                self.far_m = max(self.far_m, rays.max_m)
                yield rays

    def _read_links(self) -> None:
        """Read the frames that do not move, and the frame of the robot's base."""
        own = f"{self.namespace}/tf_static"
        names = self._bag.topics(TRANSFORMS)
        name = own if own in names else "/tf_static"
        if name in names:
            for one in self._bag.messages([name]):
                for link in one.content.transforms:
                    where = link.transform.translation
                    yaw_rad = yaw_of(link.transform.rotation) or 0.0
                    mount = Mount(where.x, where.y, yaw_rad)
                    self._links[link.child_frame_id] = (link.header.frame_id, mount)
        for one in self._bag.messages([self.odometry]):
            self._base = one.content.child_frame_id
            break

    def _mount(self, frame: str) -> Mount | None:
        if frame not in self._mounts:
            self._mounts[frame] = self._chain(frame)
        return self._mounts[frame]

    def _chain(self, frame: str) -> Mount | None:
        """Return the place of a frame on the base; None if no chain of links leads there."""
        found = Mount()
        for _ in range(MAX_LINKS):
            if frame == self._base:
                return found
            if frame not in self._links:
                return None
            frame, mount = self._links[frame]
            found = mount.of(found)
        return None


def namespace_of(topic: str) -> str:
    """Return the namespace of a topic, absolute or empty."""
    return topic.rpartition("/")[0]


def robots_in(bag: RosBag) -> list[BagRobot]:
    """Return the robots whose odometry is in a bag, in order; BagError if there is none."""
    fix = "record the topic of odometry, too"
    names = bag.require("odometry (nav_msgs/msg/Odometry)", fix, ODOMETRY)
    return [BagRobot(bag, one) for one in dict.fromkeys(map(namespace_of, names))]


def stamp_of(header: Any) -> int:
    """Return the stamp of a header in ns."""
    return int(header.stamp.sec) * NS_PER_S + int(header.stamp.nanosec)


def yaw_of(rotation: Any) -> float | None:
    """Return the heading of a quaternion in rad; None unless it is finite and about normalised."""
    x, y, z, w = rotation.x, rotation.y, rotation.z, rotation.w
    if not 0.81 < x * x + y * y + z * z + w * w < 1.21:
        return None
    return atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))


UPPER: Final = (0, 1, 5, 7, 11, 35)
"""Places of the covariances of x, y and yaw."""


def pose_in(found: Any, time_ns: int) -> BagPose | None:
    """Return the pose of nav_msgs/Odometry; None if it is not finite."""
    pose, twist = found.pose.pose, found.twist.twist
    heading_rad = yaw_of(pose.orientation)
    numbers = (pose.position.x, pose.position.y, twist.linear.x, twist.angular.z)
    if heading_rad is None or not all(map(isfinite, numbers)):
        return None
    covariance = tuple(float(found.pose.covariance[place]) for place in UPPER)
    x_m, y_m, speed_m_s, rate_rad_s = map(float, numbers)
    stamp_ns = stamp_of(found.header)
    return BagPose(time_ns, stamp_ns, x_m, y_m, heading_rad, speed_m_s, rate_rad_s, covariance)


def rays_in(found: Any, time_ns: int, mount: Mount) -> BagRays | None:
    """Return the rays of a Range or LaserScan; None without a valid one (REP 117)."""
    if hasattr(found, "ranges"):
        low_m, high_m = float(found.range_min), float(found.range_max)
        width_rad = abs(float(found.angle_increment))
        begin_rad, step_rad = float(found.angle_min), float(found.angle_increment)
        pairs = [(begin_rad + i * step_rad, one) for i, one in enumerate(found.ranges.tolist())]
    else:
        low_m, high_m = float(found.min_range), float(found.max_range)
        width_rad = abs(float(found.field_of_view))
        pairs = [(0.0, float(found.range))]
    rays = tuple(
        (bearing_rad, inf if range_m >= high_m else range_m)
        for bearing_rad, range_m in pairs
        if range_m >= low_m
    )
    if not rays or not 0.0 < high_m < inf:
        return None
    stamp_ns = stamp_of(found.header)
    return BagRays(time_ns, stamp_ns, found.header.frame_id, mount, rays, width_rad, high_m)
