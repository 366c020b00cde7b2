"""What a robot intends, for viewers: /plan and /markers.

A robot has no path, only the virtual goal that its navigator steers to, so the plan is: here, the
virtual goal, the goal. On a locked bus a gateway may not read decisions, and both are without them.
"""

from collections.abc import Sequence
from math import atan2, cos, isfinite, sin, sqrt
from typing import Any, Final

import numpy as np
from rosbags.typesys.stores.ros2_jazzy import builtin_interfaces__msg__Duration as Duration
from rosbags.typesys.stores.ros2_jazzy import geometry_msgs__msg__Point as Point
from rosbags.typesys.stores.ros2_jazzy import geometry_msgs__msg__Pose as Pose
from rosbags.typesys.stores.ros2_jazzy import geometry_msgs__msg__PoseStamped as PoseStamped
from rosbags.typesys.stores.ros2_jazzy import geometry_msgs__msg__Vector3 as Vector3
from rosbags.typesys.stores.ros2_jazzy import nav_msgs__msg__Path as Path
from rosbags.typesys.stores.ros2_jazzy import sensor_msgs__msg__CompressedImage as Image
from rosbags.typesys.stores.ros2_jazzy import std_msgs__msg__ColorRGBA as Color
from rosbags.typesys.stores.ros2_jazzy import visualization_msgs__msg__Marker as Marker
from rosbags.typesys.stores.ros2_jazzy import visualization_msgs__msg__MarkerArray as MarkerArray
from rosbags.typesys.stores.ros2_jazzy import visualization_msgs__msg__MeshFile as MeshFile

from ground.ros2.messages import BASE, MAP, Geometry, header, pose_of, yawed
from protocol.outcome import CHI2_2, doubt_of
from protocol.ring import BEARINGS_RAD, CONE_RAD
from protocol.wire.enums import Branch, GoalState
from protocol.wire.messages import (
    AvoidanceDecision,
    NavigatorStatus,
    PlanarOdometry,
    SonarScan,
)

SPHERE: Final = 2
CYLINDER: Final = 3
TEXT: Final = 9
TRIANGLES: Final = 11
LASTS: Final = Duration(1, 0)
"""Markers that are not renewed disappear."""

GREEN: Final = Color(0.1, 0.8, 0.2, 0.9)
ORANGE: Final = Color(1.0, 0.6, 0.0, 0.9)
BLUE: Final = Color(0.2, 0.5, 1.0, 0.3)
WHITE: Final = Color(1.0, 1.0, 1.0, 1.0)
UNDER_WAY: Final = (
    GoalState.ACCEPTED,
    GoalState.DRIVING,
    GoalState.AVOIDING,
    GoalState.ALIGNING,
)
Place = tuple[float, float]


def places_of(
    pose: PlanarOdometry, status: NavigatorStatus, decision: AvoidanceDecision | None
) -> list[Place]:
    """Return the places of the plan; empty without a goal."""
    if status.goal not in UNDER_WAY:
        return []
    found = [(pose.x_m, pose.y_m)]
    if decision is not None and isfinite(decision.virtual_x_m + decision.virtual_y_m):
        found.append((decision.virtual_x_m, decision.virtual_y_m))
    return [*found, (status.goal_x_m, status.goal_y_m)]


def plan(places: Sequence[Place], stamp_ns: int) -> Path:
    """Return nav_msgs/Path through the places."""
    top = header(stamp_ns, MAP)
    poses = [PoseStamped(top, Pose(Point(*place, 0.0), yawed(0.0))) for place in places]
    return Path(top, poses)


def marker(
    stamp_ns: int,
    name: str,
    kind: int,
    pose: Pose,
    scale: tuple[float, float, float],
    color: Color,
    *,
    frame: str = MAP,
    points: Sequence[Point] = (),
    text: str = "",
) -> Marker:
    """Return visualization_msgs/Marker."""
    top, nothing = header(stamp_ns, frame), np.zeros(0, np.uint8)
    texture = Image(header(0, ""), "", nothing)
    return Marker(
        *(top, name, 0, kind, 0, pose, Vector3(*scale), color, LASTS, frame == BASE),
        *(list(points), [], "", texture, [], text, "", MeshFile("", nothing), False),
    )


def ellipse(pose: PlanarOdometry, stamp_ns: int) -> Marker | None:
    """Return the ellipse in which the robot is with 95 %; None if it does not know its place."""
    if doubt_of(pose) is None:
        return None
    xx, xy, yy = pose.cov_xx_m2, pose.cov_xy_m2, pose.cov_yy_m2
    middle, spread = (xx + yy) / 2, sqrt(((xx - yy) / 2) ** 2 + xy * xy)
    long_m, short_m = (
        seen(2 * sqrt(CHI2_2 * max(0.0, one))) for one in (middle + spread, middle - spread)
    )
    where = Pose(Point(pose.x_m, pose.y_m, 0.0), yawed(atan2(2 * xy, xx - yy) / 2))
    return marker(stamp_ns, "doubt", CYLINDER, where, (long_m, short_m, 0.01), BLUE)


def seen(length_m: float) -> float:
    """Return a length that can be seen; a viewer refuses a scale of 0."""
    return max(length_m, 0.001)


def cones(scan: SonarScan, geometry: Geometry, stamp_ns: int) -> Marker:
    """Return the cone of each sonar up to its echo."""
    points = []
    for sonar, bearing_rad in enumerate(BEARINGS_RAD):
        if scan.valid & scan.echo & 1 << sonar:
            far_m = geometry.radius_m + scan.range_mm[sonar] / 1000
            corners = [(geometry.radius_m, bearing_rad)]
            corners += [(far_m, bearing_rad + side * CONE_RAD / 2) for side in (-1, 1)]
            points += [Point(r_m * cos(a_rad), r_m * sin(a_rad), 0.05) for r_m, a_rad in corners]
    here = Pose(Point(0.0, 0.0, 0.0), yawed(0.0))
    one = (1.0, 1.0, 1.0)
    return marker(stamp_ns, "sonars", TRIANGLES, here, one, BLUE, frame=BASE, points=points)


def markers(
    pose: PlanarOdometry,
    places: Sequence[Place],
    decision: AvoidanceDecision | None,
    scan: SonarScan | None,
    geometry: Geometry,
    stamp_ns: int,
) -> MarkerArray:
    """Return goal, virtual goal, decision, ellipse and cones."""
    found: list[Any] = []
    for name, place, color in zip(
        ("goal", "virtual_goal"), places[:0:-1], (GREEN, ORANGE), strict=False
    ):
        where = Pose(Point(*place, 0.0), yawed(0.0))
        found.append(marker(stamp_ns, name, SPHERE, where, (0.15, 0.15, 0.15), color))
    if decision is not None and places:
        above = pose_of(pose)
        above.position = Point(pose.x_m, pose.y_m, 0.4)
        known = [branch.name for branch in Branch if branch.value == decision.branch]
        text = known[0].lower().replace("_", " ") if known else ""
        size = (0.0, 0.0, 0.12)
        found.append(marker(stamp_ns, "decision", TEXT, above, size, WHITE, text=text))
    if (doubt := ellipse(pose, stamp_ns)) is not None:
        found.append(doubt)
    if scan is not None:
        found.append(cones(scan, geometry, stamp_ns))
    return MarkerArray(found)
