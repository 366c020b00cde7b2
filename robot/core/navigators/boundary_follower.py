"""Boundary following with eight wide sonar cones and a short memory of echoes behind.

Every echo closes the headings in which the robot, moved a short way ahead, would come too near. The
headings are swept away from the obstacle, starting at the followed point, and the first open one is
taken. It is tangent to everything closed without a gap, so the robot follows corners and ends, into
dead ends and out again.
"""

from math import pi, sqrt
from typing import Final

from robot.core.parameters import Params
from robot.core.perception.sonar_ring import Ring
from robot.core.ring import BEARINGS, HALF_CONE, SONARS
from robot.core.values import EVERY, TWO_PI, Pose, wrap
from runtime.elementary import coarse_acos, coarse_atan2, cos_sin

POINTS: Final = 12
SPACING_M: Final = 0.05
NEAR_M: Final = 0.40  # echoes beside the robot up to this range are stored
OLD_TICKS: Final = 240
WEIGHT: Final = 6
JUMP_M: Final = 0.12  # two ranges of one sonar agree within this
THROUGH_M: Final = 0.08  # an echo this far behind a stored point contradicts it
CORE_RAD: Final = 0.8 * HALF_CONE

LOOK_M: Final = 0.20
TIGHT_M: Final = 0.02  # minimum clearance
WIDE_M: Final = 0.11  # clearance where there is room
PUSH_RAD_PER_M: Final = 6.0
SHARE: Final = 0.4
SHARP_RAD: Final = 0.6  # larger changes of the course are not smoothed
QUARTER_TURN: Final = 0.5 * pi
WIDEST_RAD: Final = QUARTER_TURN + PUSH_RAD_PER_M * WIDE_M  # for a point at the rim
BOXED_RAD: Final = TWO_PI - 0.3
HALF_CONES_OUT: Final = 0.5 * HALF_CONE

OUTWARD: Final = tuple(
    [b + (HALF_CONES_OUT if b > 0.0 else -HALF_CONES_OUT) * (abs(b) > HALF_CONE) for b in BEARINGS]
)
"""Assumed bearing of an echo in its cone: a wall beside is nearest at the cone's outer edge."""


class Follower:
    """State of boundary following; `side` is the side on which the obstacle is passed.

    The anchor is the followed point. `seen_m` are the ranges without isolated false echoes and
    dropouts. `points_*` are the stored echoes of the sonar beside the robot. `bearing_rad` and
    `far_m` list the near points, `count` of them. `lost` is set without a near point, `boxed`
    without an open heading.
    """

    __slots__ = (
        "anchor_tick",
        "anchor_weight",
        "anchor_x_m",
        "anchor_y_m",
        "bearing_rad",
        "boxed",
        "count",
        "course_rad",
        "far_m",
        "lost",
        "newest",
        "older_m",
        "points_tick",
        "points_weight",
        "points_x_m",
        "points_y_m",
        "recent_m",
        "seen_m",
        "side",
        "tick",
        "tight_rad",
        "turn_rad",
    )

    def __init__(self) -> None:
        self.side = 1
        self.recent_m: list[float | None] = [None] * SONARS
        self.older_m: list[float | None] = [None] * SONARS
        self.seen_m: list[float | None] = [None] * SONARS
        self.points_x_m = [0.0] * POINTS
        self.points_y_m = [0.0] * POINTS
        self.points_weight = [0] * POINTS
        self.points_tick = [0] * POINTS
        self.newest = self.tick = self.count = self.anchor_weight = self.anchor_tick = 0
        self.anchor_x_m = self.anchor_y_m = 0.0
        size = SONARS + POINTS + 1
        self.bearing_rad = [0.0] * size
        self.far_m = [0.0] * size
        self.turn_rad = [0.0] * size
        self.tight_rad = [0.0] * size
        self.course_rad = 0.0
        self.lost = self.boxed = False


def sense(follower: Follower, pose: Pose, ring: Ring, params: Params) -> None:
    """Take one scan; store the echo beside the robot before the obstacle leaves the view."""
    follower.tick += 1
    recent_m, older_m, seen_m = follower.recent_m, follower.older_m, follower.seen_m
    for i in EVERY:
        here_m, last_m = ring.range_m[i], recent_m[i]
        # A missing range counts at once; a range must agree with one of the last two.
        if here_m is None or last_m is None or -JUMP_M < here_m - last_m < JUMP_M:
            seen_m[i] = here_m
        else:
            before_m = older_m[i]
            agrees = before_m is not None and -JUMP_M < here_m - before_m < JUMP_M
            seen_m[i] = here_m if agrees else last_m
        older_m[i] = last_m
        recent_m[i] = here_m
    beside = 0 if follower.side > 0 else SONARS - 1
    range_m = seen_m[beside]
    if range_m is not None and range_m < NEAR_M:
        remember(follower, pose, beside, range_m + params.radius_m)


def remember(follower: Follower, pose: Pose, sonar: int, far_m: float) -> None:
    """Store the place of an echo; an echo next to the last one only refreshes that."""
    cosine, sine = cos_sin(pose.heading_rad + OUTWARD[sonar])
    x_m, y_m = pose.x_m + far_m * cosine, pose.y_m + far_m * sine
    k = follower.newest
    dx_m, dy_m = x_m - follower.points_x_m[k], y_m - follower.points_y_m[k]
    if not follower.points_weight[k] or dx_m * dx_m + dy_m * dy_m > SPACING_M * SPACING_M:
        k = (k + 1) % POINTS
        follower.newest = k
        follower.points_x_m[k], follower.points_y_m[k] = x_m, y_m
    follower.points_weight[k] = WEIGHT
    follower.points_tick[k] = follower.tick


def start(follower: Follower, pose: Pose, side: int, toward_rad: float, params: Params) -> None:
    """Start to follow the point nearest to the bearing `toward_rad`."""
    follower.side = side
    follower.lost = follower.boxed = False
    follower.course_rad = pose.heading_rad
    gather(follower, pose, params)
    anchor(follower, pose, nearest(follower, toward_rad))


def nearest(follower: Follower, toward_rad: float) -> int:
    """Return the index of the point that most obstructs this bearing, or -1."""
    best, best_m = -1, 1e9
    for k in range(follower.count):
        aside = abs(wrap(follower.bearing_rad[k] - toward_rad))
        cost_m = follower.far_m[k] * (1.0 + aside)
        if cost_m < best_m:
            best, best_m = k, cost_m
    return best


def anchor(follower: Follower, pose: Pose, k: int) -> None:
    """Follow the near point k from now on; -1 changes nothing."""
    if k < 0:
        return
    cosine, sine = cos_sin(pose.heading_rad + follower.bearing_rad[k])
    follower.anchor_x_m = pose.x_m + follower.far_m[k] * cosine
    follower.anchor_y_m = pose.y_m + follower.far_m[k] * sine
    follower.anchor_weight = WEIGHT
    follower.anchor_tick = follower.tick


def gather(follower: Follower, pose: Pose, params: Params) -> None:
    """List the points near enough to matter: current echoes, then stored ones."""
    reach_m = LOOK_M + params.radius_m + WIDE_M
    count = 0
    for i in EVERY:
        range_m = follower.seen_m[i]
        if range_m is not None and range_m + params.radius_m < reach_m:
            follower.bearing_rad[count] = OUTWARD[i]
            follower.far_m[count] = range_m + params.radius_m
            count += 1
    follower.count = count
    oldest = follower.tick - OLD_TICKS
    here_x_m, here_y_m, heading_rad = pose
    square_m2 = reach_m * reach_m
    for k in range(POINTS):
        weight = follower.points_weight[k]
        if weight > 0 and follower.points_tick[k] > oldest:
            dx_m, dy_m = follower.points_x_m[k] - here_x_m, follower.points_y_m[k] - here_y_m
            if dx_m * dx_m + dy_m * dy_m < square_m2:
                lost = recall(follower, heading_rad, dx_m, dy_m, params)
                follower.points_weight[k] = weight - lost


def recall(follower: Follower, heading_rad: float, dx_m: float, dy_m: float, params: Params) -> int:
    """List a near stored point; return the weight it loses because echoes contradict it."""
    far_m = sqrt(dx_m * dx_m + dy_m * dy_m)
    bearing_rad = wrap(coarse_atan2(dy_m, dx_m) - heading_rad)
    k = follower.count
    follower.bearing_rad[k] = bearing_rad
    follower.far_m[k] = far_m
    follower.count = k + 1
    if -QUARTER_TURN < bearing_rad < QUARTER_TURN:
        i = int((bearing_rad + QUARTER_TURN) / (2.0 * HALF_CONE))
        if abs(bearing_rad - BEARINGS[i]) < CORE_RAD:
            range_m = follower.seen_m[i]
            if range_m is not None and range_m + params.radius_m > far_m + THROUGH_M:
                return 2 if range_m < params.sonar_max_m else 1
    return 0


def half_width(far_m: float, room_m: float) -> float:
    """Return half the sector of headings that a point closes for a disc of radius `room_m`."""
    if far_m <= room_m:
        return QUARTER_TURN + PUSH_RAD_PER_M * (room_m - far_m)
    square, room2 = far_m * far_m, room_m * room_m
    if square <= LOOK_M * LOOK_M + room2:
        return QUARTER_TURN - coarse_acos(room_m / far_m)
    cosine = (square + LOOK_M * LOOK_M - room2) / (2.0 * far_m * LOOK_M)
    return coarse_acos(cosine) if cosine < 1.0 else 0.0


def heading(follower: Follower, pose: Pose, params: Params) -> float:
    """Return the bearing along the boundary; set `lost` without one, `boxed` if enclosed."""
    gather(follower, pose, params)
    live = follower.count
    reach_m = 2.0 * (LOOK_M + params.radius_m + WIDE_M)
    dx_m, dy_m = follower.anchor_x_m - pose.x_m, follower.anchor_y_m - pose.y_m
    if dx_m * dx_m + dy_m * dy_m < reach_m * reach_m:
        follower.anchor_weight -= recall(follower, pose.heading_rad, dx_m, dy_m, params)
    old = follower.tick - follower.anchor_tick > OLD_TICKS
    if follower.anchor_weight <= 0 or old or follower.count == live:
        follower.count = live
        k = nearest(follower, -follower.side * QUARTER_TURN)
        follower.lost = k < 0
        anchor(follower, pose, k)
        if k < 0:
            return 0.0
        start_rad = follower.bearing_rad[k]
    else:
        start_rad = follower.bearing_rad[live]
    swept_rad, last = sweep(follower, start_rad, params)
    follower.boxed = swept_rad >= BOXED_RAD
    if follower.boxed:
        return follower.side * QUARTER_TURN
    wide_rad = widened(follower, swept_rad, params)
    if last >= 0 and last != live:
        anchor(follower, pose, last)
    return smoothed(follower, pose, start_rad + follower.side * wide_rad)


def smoothed(follower: Follower, pose: Pose, turn_rad: float) -> float:
    """Return the bearing of a low-pass filtered course, which wavers less."""
    change_rad = wrap(pose.heading_rad + turn_rad - follower.course_rad)
    share = SHARE if -SHARP_RAD < change_rad < SHARP_RAD else 1.0
    follower.course_rad = wrap(follower.course_rad + share * change_rad)
    return wrap(follower.course_rad - pose.heading_rad)


def sweep(follower: Follower, start_rad: float, params: Params) -> tuple[float, int]:
    """Return the turn from `start_rad` to the first open heading, and the last closing point."""
    room_m = params.radius_m + TIGHT_M
    turn_rad, tight_rad = follower.turn_rad, follower.tight_rad
    for k in range(follower.count):
        turn = follower.side * wrap(follower.bearing_rad[k] - start_rad)
        tight = half_width(follower.far_m[k], room_m)
        turn_rad[k] = turn + TWO_PI if turn + tight <= 0.0 and turn < 0.0 else turn
        tight_rad[k] = tight
    swept, last, moved = 0.0, -1, True
    while moved and swept < BOXED_RAD:
        moved = False
        for k in range(follower.count):
            end = turn_rad[k] + tight_rad[k]
            if swept < end and turn_rad[k] - tight_rad[k] <= swept:
                swept, last, moved = end, k, True
    return swept, last


def widened(follower: Follower, swept_rad: float, params: Params) -> float:
    """Return the turn into the same gap with more clearance, or to the middle of the gap."""
    room_m = params.radius_m + WIDE_M
    near, far, edge = swept_rad, 1e9, 1e9
    for k in range(follower.count):
        turn, tight = follower.turn_rad[k], follower.tight_rad[k]
        if turn - tight <= swept_rad:
            if turn + WIDEST_RAD > near:
                wide = half_width(follower.far_m[k], room_m)
                if wide > 0.0 and turn + wide > near:
                    near = turn + wide
            continue
        if turn - tight < edge:
            edge = turn - tight
        if turn - WIDEST_RAD < far:
            far = min(far, turn - half_width(follower.far_m[k], room_m))
    if near <= far:
        return near
    return min(max(0.5 * (near + far), swept_rad), edge)
