"""Play a bag of ROS 2 as a recording: the way of each robot, and what it sensed.

Odometry becomes odometry, and ranges become scans of the eight sonars: of a laser each cone has its
nearest point. A bag has neither goals nor decisions, so the state of the robot stays unknown.
"""

import json
from collections.abc import Iterator
from contextlib import ExitStack
from heapq import merge
from math import atan2, cos, floor, hypot, inf, isfinite, nan, sin
from pathlib import Path
from typing import Final

from protocol.ring import CONE_RAD, RADIUS_M, SONARS
from protocol.ros_bag import BagError, BagPose, BagRays, BagRobot, RosBag, robots_in
from protocol.topics import ODOMETRY, SONAR, sender_of
from protocol.wire.codec import Encoder
from protocol.wire.messages import PlanarOdometry, SonarScan
from runtime.units import NS_PER_US

UNKNOWN: Final = 1e5
"""A variance from this on means that the place is unknown."""

MAX_MM: Final = 65_535
MAX_AGE_US: Final = 65_535
MAX_STAMP_NS: Final = 1 << 63


class BagFrames:
    """The frames of all robots in a bag, read once from front to back; one robot is the main one.

    `share` of the messages were read, and `records` frames made of them.
    """

    def __init__(self, path: Path, robot: str | None) -> None:
        """Open a bag; BagError if it cannot be used, or has no such robot."""
        self.records = 0
        self.facts: dict[str, str] = {}
        """After reading: the circle from which sonars count here, and the largest range."""

        self._path = path
        self._bags: list[RosBag] = []
        self._robots: list[BagRobot] = []
        with RosBag(path) as bag:
            names = [one.name for one in robots_in(bag)]
        if robot is not None and robot not in names:
            reason = f"it has no robot {robot!r}, but {', '.join(names)}"
            raise BagError(path, reason, "leave --id out, or give one of these")
        self.robot = robot or names[0]

    def frames(self) -> Iterator[tuple[int, str, bytes]]:
        """Yield time of arrival, key and frame, in order; BagError if the bag is damaged."""
        self.records = 0
        self._bags, self._robots = [], []
        with ExitStack() as stack:
            bag = stack.enter_context(RosBag(self._path))
            for number, robot in enumerate(robots_in(bag)):
                if number:  # each is read by itself
                    bag = stack.enter_context(RosBag(self._path))
                self._bags.append(bag)
                self._robots.append(BagRobot(bag, robot.namespace))
            for one in merge(*map(frames_of, self._robots)):
                self.records += 1
                yield one
            far_m = max((one.far_m for one in self._robots), default=0.0)
            if far_m > 0.0:
                rows = [("radius_m", RADIUS_M), ("sonar_max_m", far_m)]
                listed = [{"name": name, "value": value} for name, value in rows]
                self.facts["parameters"] = json.dumps(listed)

    @property
    def share(self) -> float:
        """Share of the messages that was read."""
        asked = sum(bag.asked for bag in self._bags)
        return sum(bag.read for bag in self._bags) / max(1, asked)

    def damage(self) -> str:
        """Return what was lost, in words."""
        found = []
        if unreadable := sum(bag.unreadable for bag in self._bags):
            found.append(f"{unreadable} messages are malformed and were skipped")
        if frames := sorted({frame for one in self._robots for frame in one.left_out}):
            found.append(f"ranges of {', '.join(frames)} were left out: no transform leads there")
        return "; ".join(found)


def frames_of(robot: BagRobot) -> Iterator[tuple[int, str, bytes]]:
    """Yield the frames of one robot; a scan has what was measured between two poses."""
    poses = Encoder(*sender_of(ODOMETRY.publisher, robot.name))
    scans = Encoder(*sender_of(SONAR.publisher, robot.name))
    ring = Ring()
    for event in robot.events():
        if isinstance(event, BagRays):
            ring.add(event)
            continue
        if (scan := ring.scan(event.stamp_ns)) is not None:
            yield event.time_ns, SONAR.key(robot.name), scans.encode(scan)
        yield event.time_ns, ODOMETRY.key(robot.name), poses.encode(odometry(event))


def odometry(pose: BagPose) -> PlanarOdometry:
    """Return our odometry."""
    known = pose.covariance
    if not all(isfinite(one) and abs(one) < UNKNOWN for one in known):
        known = (nan,) * len(known)
    return PlanarOdometry(
        time_ns=pose.stamp_ns % MAX_STAMP_NS,
        x_m=pose.x_m,
        y_m=pose.y_m,
        heading_rad=pose.heading_rad,
        speed_m_s=pose.speed_m_s,
        yaw_rate_rad_s=pose.yaw_rate_rad_s,
        cov_xx_m2=known[0],
        cov_xy_m2=known[1],
        cov_xh_m_rad=known[2],
        cov_yy_m2=known[3],
        cov_yh_m_rad=known[4],
        cov_hh_rad2=known[5],
    )


class Ring:
    """The nearest echo in each cone of the sonars since the last scan."""

    def __init__(self) -> None:
        self._nearest_m: dict[int, float] = {}
        self._stamps_ns: dict[int, int] = {}
        self._sequence = 0

    def add(self, event: BagRays) -> None:
        """Take rays; those to the back are outside of all cones."""
        mount = event.mount
        for bearing_rad, range_m in event.rays:
            reach_m = event.max_m if range_m == inf else range_m
            x_m = mount.x_m + reach_m * cos(mount.yaw_rad + bearing_rad)
            y_m = mount.y_m + reach_m * sin(mount.yaw_rad + bearing_rad)
            sonar = floor(atan2(y_m, x_m) / CONE_RAD + SONARS / 2)
            if 0 <= sonar < SONARS:
                far_m = inf if range_m == inf else max(0.0, hypot(x_m, y_m) - RADIUS_M)
                self._nearest_m[sonar] = min(far_m, self._nearest_m.get(sonar, inf))
                self._stamps_ns[sonar] = event.stamp_ns

    def scan(self, stamp_ns: int) -> SonarScan | None:
        """Return what was measured since the last scan; None if nothing was."""
        found, self._nearest_m = self._nearest_m, {}
        if not found:
            return None
        self._sequence = self._sequence % MAX_MM + 1
        ages_us = [0] * SONARS
        for sonar in found:
            age_us = (stamp_ns - self._stamps_ns[sonar]) // NS_PER_US
            ages_us[sonar] = min(max(0, age_us), MAX_AGE_US)
        return SonarScan(
            time_ns=stamp_ns % MAX_STAMP_NS,
            seq=self._sequence,
            range_mm=tuple(
                min(MAX_MM, round(1000 * found[sonar])) if found.get(sonar, inf) < inf else 0
                for sonar in range(SONARS)
            ),
            ping_age_us=tuple(ages_us),
            valid=sum(1 << sonar for sonar in found),
            echo=sum(1 << sonar for sonar, far_m in found.items() if far_m < inf),
        )
