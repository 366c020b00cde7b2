"""Draw a scene on a canvas, layer by layer; later layers cover earlier ones.

What does not move with the robot (walls, fence, ghosts, other robots) is drawn again only when it
has changed; the robot, its sonars, its goal and other moving things, in every frame. Marks and
places of the map are described in words, too.
"""

from collections.abc import Callable, Collection, Iterable, Sequence
from itertools import pairwise, repeat
from math import atan2, cos, degrees, dist, hypot, inf, isfinite, pi, sin
from typing import Final

from ground.map.canvas import DOTS_WIDE, DOTTED, MARKS, Canvas, hue_of
from ground.map.pen import Pen, ellipse
from ground.map.scene import (
    LAYERS,
    MIN_LEGEND_ROWS,
    Disc,
    MapScene,
    MapTarget,
    Outline,
    Point,
    RobotMark,
    Shape,
    View,
    floor,
)
from protocol.ring import CONE_RAD

NOT_LIVE: Final = "NOT LIVE"
NO_PLACE: Final = "PLACE UNKNOWN"
GAP: Final = "  "
Entry = tuple[str, str]
"""Some words and their role."""


def legend(
    scene: MapScene, room: int, *, ascii_only: bool = False, is_mono: bool = False
) -> list[Entry]:
    """Return as many entries of the legend as fit into `room` columns."""
    found: list[Entry] = []
    for words, role in entries(scene, int(ascii_only), is_mono):
        room -= len(words) + (len(GAP) if found else 0)
        if room < 0:
            break
        found.append((words, role))
    return found


def seen_mark(*, ascii_only: bool, is_mono: bool) -> str:
    """Return the character of echoes: in colour, age is a shade of dots, else a character."""
    return MARKS["seen"][ascii_only] if ascii_only or is_mono else DOTTED


def entries(scene: MapScene, form: int, is_mono: bool = False) -> list[Entry]:
    """Return all entries of a scene; `form` is 0 for Unicode, 1 for ASCII."""
    echo = seen_mark(ascii_only=bool(form), is_mono=is_mono)
    walled = scene.obstacles or scene.size_m
    in_need = any(other.in_need and other.live for other in scene.others)
    table = (
        (not scene.live, NOT_LIVE, "text"),
        (not scene.placed, NO_PLACE, "text"),
        (bool(scene.note), scene.note, "text"),
        (scene.robot is not None and scene.live, f"{'▶>'[form]} robot", "robot"),
        (scene.goal is not None, f"{MARKS['goal'][form]} goal", "goal"),
        (in_need, f"{MARKS['in need'][form]} in trouble", "danger"),
        (scene.has_dead_sonar, f"{MARKS['dead sonar'][form]} dead", "dead sonar"),
        (scene.truth and walled, f"{'─-'[form]} truth", "truth"),
        (scene.true_robot is not None, f"{('○', '()')[form]} true robot", "true robot"),
        (bool(scene.seen or scene.seen_late or scene.seen_old), f"{echo} seen", "seen"),
        (scene.virtual_goal is not None, f"{MARKS['virtual'][form]} virtual", "virtual"),
        (bool(scene.hits or scene.leaves), "H/L hit/leave", "hit"),
        (bool(scene.mission), f"{MARKS['waypoint'][form]} mission", "mission"),
        (bool(scene.others), f"{MARKS['other'][form]} other robots", "text"),
        (bool(scene.movers), f"{MARKS['mover'][form]} moving", "truth"),
        (bool(scene.fence), f"{'⠒.'[form]} fence", "fence"),
        (bool(scene.ghosts), f"{MARKS['ended'][form]} ghost", "ghost"),
    )
    return [(words, role) for shown, words, role in table if shown]


EDGE_SPACING: Final = 3
HEADING_DOTS: Final = 9.0
MARKED_OUTCOMES: Final = {
    "reached": "reached",
    "collided": "collided",
    "stuck": "stuck",
    "unreachable": "unreachable",
    "lost": "ghost lost",  # `lost` is the mark of a robot without a place
}
"""The marks of the outcomes of ghosts; other outcomes have the mark `ended`."""


def draw_walls(pen: Pen, scene: MapScene) -> None:
    """Draw the obstacles, and the edge of the floor as dots where it has no wall."""
    role = "truth" if scene.truth else "wall"
    if scene.size_m is not None:
        dotted(pen, Outline(floor(scene.size_m)), role)
    for obstacle in scene.obstacles:
        pen.shape(obstacle, role)


def draw_seen(pen: Pen, scene: MapScene) -> None:
    """Draw where the robot has seen obstacles, by age; without colours, by characters, too."""
    pen.dots(scene.seen_old, "seen old")
    draw_echoes(pen, scene.seen_late, "seen late")
    draw_echoes(pen, scene.seen, "seen")


def draw_echoes(pen: Pen, points: Iterable[Point], role: str) -> None:
    """Draw echoes beneath the traces that may be there already."""
    pen.dots(points, role, below="ghost")
    for at in points if pen.canvas.ascii_only or pen.canvas.is_mono else ():
        pen.mark(at, role, role)


def draw_fence(pen: Pen, scene: MapScene) -> None:
    """Draw the fence as dots, so that it differs from a wall without colours, too."""
    for shape in scene.fence:
        dotted(pen, shape, "fence")


def draw_ghosts(pen: Pen, scene: MapScene) -> None:
    """Draw the path of each ghost, with its outcome at the end."""
    for ghost in scene.ghosts:
        pen.path(ghost.path_m, "ghost")
        if ghost.path_m:
            label = " ".join(word for word in (ghost.label, ghost.outcome) if word)
            end = MARKED_OUTCOMES.get(ghost.outcome, "ended")
            pen.mark(ghost.path_m[-1], end, "ghost", label)


def draw_hit_points(pen: Pen, scene: MapScene) -> None:
    """Draw where the robot met and left the boundary of an obstacle."""
    for at in scene.hits:
        pen.mark(at, "hit", "hit")
    for at in scene.leaves:
        pen.mark(at, "leave", "leave")


def draw_mission(pen: Pen, scene: MapScene) -> None:
    """Draw the items of the mission, counted from 1; a `>` marks the one under way."""
    under_way = None if scene.current is None else scene.current + 1
    draw_legs(pen, scene.mission, "mission", 2 * EDGE_SPACING)
    for at, item in enumerate(scene.mission, start=1):
        number = item.number or at
        label = f"{'>' if number == under_way else ''}{number}"
        pen.mark((item.x_m, item.y_m), "waypoint", "mission", label, heads_right(item))


def draw_draft(pen: Pen, scene: MapScene) -> None:
    """Draw the draft of a mission with hollow marks, numbers with a `d`, and fewer dots."""
    draw_legs(pen, scene.draft, "draft", 4 * EDGE_SPACING)
    for at, item in enumerate(scene.draft, start=1):
        label = f"d{item.number or at}"
        pen.mark((item.x_m, item.y_m), "draft", "draft", label, heads_right(item))


def draw_legs(pen: Pen, items: Sequence[MapTarget], role: str, every: int) -> None:
    """Draw dotted lines from item to item, and the heading at each."""
    for a, b in pairwise([(item.x_m, item.y_m) for item in items]):
        pen.dotted(a, b, role, every)
    for item in items:
        draw_heading(pen, item, role)


def draw_heading(pen: Pen, target: MapTarget, role: str) -> None:
    """Draw the tolerance, where it is large enough to see, and the heading on arrival."""
    at: Point = (target.x_m, target.y_m)
    if target.tolerance_m > DOTS_WIDE * pen.view.m_per_dot:
        pen.circle(at, target.tolerance_m, role)
    if target.heading_rad is not None and isfinite(target.heading_rad):
        length_m = HEADING_DOTS * pen.view.m_per_dot
        tip = at[0] + length_m * cos(target.heading_rad), at[1] + length_m * sin(target.heading_rad)
        pen.path((at, tip), role)


def heads_right(target: MapTarget) -> bool:
    """Return whether the heading is drawn to the right, where the label would be."""
    heading_rad = target.heading_rad
    return heading_rad is not None and isfinite(heading_rad) and cos(heading_rad) > 0.5


def dotted(pen: Pen, shape: Shape, role: str) -> None:
    """Draw the edge of a shape as dots."""
    if isinstance(shape, Disc):
        points = pen.curve((shape.x_m, shape.y_m), shape.radius_m, shape.radius_m)
    else:
        points = (*shape.points_m, *shape.points_m[:1])
    for a, b in pairwise(points):
        pen.dotted(a, b, role, EDGE_SPACING)


CONE_SPACING: Final = 3
LINE_SPACING: Final = 4
NOSE_DOTS: Final = 5.0
SOLID_DOTS: Final = 6.0
DEAD_DOTS: Final = 6.0
"""Distance of the mark of a dead sonar from the rim, so that it is beside the robot's mark."""
FILLED_DOTS: Final = 60.0
"""A robot with a greater radius than this is only an outline: it would fill the map."""
NOT_DRAWN: Final = -1.0


def draw_trail(pen: Pen, scene: MapScene) -> None:
    """Draw the way that the robot has driven."""
    pen.path(scene.trail, "trail")


def draw_ellipse(pen: Pen, scene: MapScene) -> None:
    """Draw the uncertainty of the robot's position."""
    robot, covariance = scene.robot, scene.covariance
    axes = ellipse(covariance) if covariance is not None else None
    if robot is not None and axes is not None:
        pen.path(pen.curve((robot.x_m, robot.y_m), *axes), "ellipse")


def draw_zone(pen: Pen, scene: MapScene) -> None:
    """Draw the ring within which the robot avoids obstacles."""
    robot, zone_m = scene.robot, scene.zone_m
    if robot is None or robot.radius_m is None or zone_m is None or zone_m <= 0.0:
        return
    pen.circle((robot.x_m, robot.y_m), robot.radius_m + zone_m, "zone")


def draw_sonars(pen: Pen, scene: MapScene) -> None:
    """Draw for each echo the arc on which the obstacle must lie, and the edges of its cone.

    A sonar without a reading has a mark instead.
    """
    robot = scene.robot
    if robot is None or robot.radius_m is None or not scene.shows_sonars:
        return
    at, rim_m = (robot.x_m, robot.y_m), robot.radius_m
    echoes_m = [_echo_m(range_m) for range_m in scene.ranges_m]
    first_rad = robot.heading_rad - len(echoes_m) / 2.0 * CONE_RAD
    for edge, sides_m in enumerate(pairwise((NOT_DRAWN, *echoes_m, NOT_DRAWN))):
        edge_rad = first_rad + edge * CONE_RAD
        if max(sides_m) > NOT_DRAWN:
            rim, end = point_at(at, edge_rad, rim_m), point_at(at, edge_rad, rim_m + max(sides_m))
            pen.dotted(rim, end, "cone", CONE_SPACING)
    for sonar, echo_m in enumerate(echoes_m):
        begun_rad = first_rad + sonar * CONE_RAD
        if echo_m > NOT_DRAWN:
            pen.arc(at, rim_m + echo_m, (begun_rad, begun_rad + CONE_RAD), "echo")
        elif scene.ranges_m[sonar] is None:
            mark_m = rim_m + DEAD_DOTS * pen.view.m_per_dot
            pen.mark(point_at(at, begun_rad + CONE_RAD / 2.0, mark_m), "dead sonar", "dead sonar")


def draw_virtual(pen: Pen, scene: MapScene) -> None:
    """Draw the virtual goal and a line to it, unless it is the goal itself."""
    at, robot = scene.virtual_goal, scene.robot
    if at is None or (scene.goal and dist(at, (scene.goal.x_m, scene.goal.y_m)) < 1e-6):
        return
    if robot is not None:
        pen.dotted((robot.x_m, robot.y_m), at, "virtual", LINE_SPACING)
    pen.mark(at, "virtual", "virtual", "virtual")
    pen.off_map(at, "virtual", "virtual")


def draw_goal(pen: Pen, scene: MapScene) -> None:
    """Draw the goal; when it is off the map, an arrow with its distance in metres."""
    goal = scene.goal
    if goal is None:
        return
    at, robot = (goal.x_m, goal.y_m), scene.robot
    draw_heading(pen, goal, "goal")
    pen.mark(at, "goal", "goal", "goal", heads_right(goal))
    away_m = None if robot is None else dist((robot.x_m, robot.y_m), at)
    pen.off_map(at, "goal", "goal" if away_m is None else f"goal {away_m:.1f} m")


def draw_movers(pen: Pen, scene: MapScene) -> None:
    """Draw moving obstacles from the simulation truth."""
    for mover in scene.movers:
        pen.shape(mover, "truth")
        pen.mark((mover.x_m, mover.y_m), "mover", "truth")


def draw_others(pen: Pen, scene: MapScene) -> None:
    """Draw other robots, those that need attention above the others.

    All of these have their names, and as many others as have room.
    """
    others = sorted(scene.others, key=lambda other: other.in_need)
    for other in others:
        role = other_role(other)
        _body(pen, other, role)
        mark = ("in need" if other.in_need else "other") if other.live else "lost"
        pen.mark((other.x_m, other.y_m), mark, role)
    for other in reversed(others):
        at, role = (other.x_m, other.y_m), other_role(other)
        pen.label(at, other.name, role, is_optional=not other.in_need)


def other_role(other: RobotMark) -> str:
    """Return the role of the colour of another robot."""
    return "danger" if other.in_need else f"other {hue_of(other.name)}"


def draw_true_robot(pen: Pen, scene: MapScene) -> None:
    """Draw the outline of the robot where the simulation has it."""
    if scene.true_robot is not None:
        _body(pen, scene.true_robot, "true robot")


def draw_robot(pen: Pen, scene: MapScene) -> None:
    """Draw the robot true to scale and filled, and a mark that stays visible at any scale."""
    robot = scene.robot
    if robot is None:
        return
    at, label = (robot.x_m, robot.y_m), robot.name if scene.others else ""
    if robot.radius_m is not None and robot.radius_m <= FILLED_DOTS * pen.view.m_per_dot:
        pen.disc(at, robot.radius_m, "robot")
        pen.uncover(at, robot.radius_m, "robot")
    _body(pen, robot, "robot")
    if scene.live:
        pen.heading(at, robot.heading_rad, "robot", label)
    else:
        pen.mark(at, "lost", "robot", label)
    pen.off_map(at, "robot", robot.name or "robot")


def draw_cursor(pen: Pen, scene: MapScene) -> None:
    """Draw the cursor with its position in metres."""
    if scene.cursor is not None:
        words = f"{scene.cursor[0]:z.2f} {scene.cursor[1]:z.2f}"
        pen.mark(scene.cursor, "cursor", "cursor", words)
        pen.off_map(scene.cursor, "cursor", words)


def point_at(at: Point, bearing_rad: float, length_m: float) -> Point:
    """Return the point at a bearing (radians) and distance from `at`."""
    return at[0] + length_m * cos(bearing_rad), at[1] + length_m * sin(bearing_rad)


def _body(pen: Pen, robot: RobotMark, role: str) -> None:
    """Draw a robot's outline and nose; fill it when small, to differ from an obstacle.

    Without a known radius there is only the nose.
    """
    at, radius_m = (robot.x_m, robot.y_m), robot.radius_m
    dot_m = pen.view.m_per_dot
    if radius_m is not None:
        if radius_m < SOLID_DOTS * dot_m:
            pen.disc(at, radius_m, role)
        pen.circle(at, radius_m, role)
    if isfinite(robot.heading_rad):
        nose_m = (radius_m or 0.0) + NOSE_DOTS * dot_m
        pen.path((at, point_at(at, robot.heading_rad % (2.0 * pi), nose_m)), role)


def _echo_m(range_m: float | None) -> float:
    """Return the range of an echo; NOT_DRAWN for a missing, infinite or invalid range."""
    return range_m if range_m is not None and 0.0 <= range_m < inf else NOT_DRAWN


Layer = Callable[[Pen, MapScene], None]

STATIC: Final[tuple[tuple[str, Layer], ...]] = (
    ("walls", draw_walls),
    ("fence", draw_fence),
)
TRACES: Final[tuple[tuple[str, Layer], ...]] = (
    ("others", draw_others),
    ("seen", draw_seen),
    ("ghosts", draw_ghosts),
    ("trail", draw_trail),
)

BAR_SHARE: Final = 6
"""The scale bar takes at most one of so many columns."""


def draw_legend(pen: Pen, scene: MapScene) -> None:
    """Draw the scale bar and the legend into the last row, when there are rows enough."""
    canvas = pen.canvas
    row = canvas.rows - 1
    if canvas.rows < MIN_LEGEND_ROWS:
        return
    length_m, cells = pen.view.scale_bar(canvas.columns // BAR_SHARE)
    canvas.mark(0, row, "bar left", "text")
    for column in range(1, cells - 1):
        canvas.mark(column, row, "bar", "text")
    canvas.mark(cells - 1, row, "bar right", "text")
    length = length_text(length_m)
    canvas.text(cells + 1, row, length, "text")
    column = cells + len(length) + 3
    room, forms = canvas.columns - column, (canvas.ascii_only, canvas.is_mono)
    for words, role in legend(scene, room, ascii_only=forms[0], is_mono=forms[1]):
        canvas.text(column, row, words, role)
        column += len(words) + len(GAP)


def length_text(length_m: float) -> str:
    """Return a length in a fitting unit: 0.5 mm, 2 cm, 5 m, 2 km."""
    for unit, size_m in (("km", 1000.0), ("m", 1.0), ("cm", 0.01)):
        if length_m >= size_m * 0.999:
            return f"{length_m / size_m:g} {unit}"
    return f"{length_m * 1000.0:g} mm"


MOVING: Final[tuple[tuple[str, Layer], ...]] = (
    ("ellipse", draw_ellipse),
    ("zone", draw_zone),
    ("sonars", draw_sonars),
    ("marks", draw_hit_points),
    ("draft", draw_draft),
    ("mission", draw_mission),
    ("virtual", draw_virtual),
    ("goal", draw_goal),
    ("others", draw_movers),
    ("truth", draw_true_robot),
    ("robot", draw_robot),
    ("cursor", draw_cursor),
    ("legend", draw_legend),
)


def draw(scene: MapScene, view: View, canvas: Canvas, layers: Collection[str] = LAYERS) -> None:
    """Draw the named layers of a scene (see `scene.LAYERS`)."""
    draw_static(scene, view, canvas, layers)
    draw_other_trails(scene, view, canvas, layers)
    draw_traces(scene, view, canvas, layers)
    draw_moving(scene, view, canvas, layers)


def draw_static(
    scene: MapScene, view: View, canvas: Canvas, layers: Collection[str] = LAYERS
) -> None:
    """Draw the layers that stay the same while `static_parts` does."""
    _draw(STATIC, scene, Pen(canvas, view), layers)


def draw_other_trails(
    scene: MapScene,
    view: View,
    canvas: Canvas,
    layers: Collection[str] = LAYERS,
    *,
    drawn: Iterable[int] = repeat(0),
) -> None:
    """Draw the ways that other robots have driven; so many points of each are `drawn` already."""
    if "trail" not in layers:
        return
    pen = Pen(canvas, view)
    for other, points in zip(scene.others, drawn, strict=False):
        if len(other.trail) > points:
            pen.path(other.trail[max(0, points - 1) :], f"trail {hue_of(other.name)}")


def draw_traces(
    scene: MapScene,
    view: View,
    canvas: Canvas,
    layers: Collection[str] = LAYERS,
    *,
    drawn: tuple[int, int] | None = None,
) -> None:
    """Draw the layers above the static ones.

    They change only with `trace_parts`, the newest echoes and the trail. So many of the newest
    echoes, and points of the trail, are `drawn` on the canvas already; draw the others.
    """
    pen = Pen(canvas, view)
    if drawn is None:
        _draw(TRACES, scene, pen, layers)
        return
    echoes, points = drawn
    if "seen" in layers:
        draw_echoes(pen, scene.seen[echoes:], "seen")
    if "trail" in layers and len(scene.trail) > points:
        pen.path(scene.trail[max(0, points - 1) :], "trail")


def draw_moving(
    scene: MapScene, view: View, canvas: Canvas, layers: Collection[str] = LAYERS
) -> None:
    """Draw all other layers."""
    _draw(MOVING, scene, Pen(canvas, view), layers)


def static_parts(scene: MapScene) -> tuple[object, ...]:
    """Return the parts of a scene that `draw_static` draws, for comparison."""
    return scene.size_m, scene.obstacles, scene.truth, scene.fence


def trace_parts(scene: MapScene) -> tuple[object, ...]:
    """Return the parts of a scene that `draw_traces` draws, for comparison.

    Not the newest echoes and the trail, which grow at their end.
    """
    return scene.seen_late, scene.seen_old, scene.ghosts, scene.others


def _draw(
    table: tuple[tuple[str, Layer], ...], scene: MapScene, pen: Pen, layers: Collection[str]
) -> None:
    for name, layer in table:
        if name in layers:
            layer(pen, scene)


class KeptLayers:
    """Canvases with the static layers, with the trails of others above them, and with the traces.

    Of what only grows, such as a trail, the new part is drawn.
    """

    def __init__(self) -> None:
        self._static = self._trails = self._traced = Canvas(0, 0)
        self._other_trails: tuple[Sequence[Point], ...] = ()
        self._static_key: tuple[object, ...] = ()
        self._trace_key: tuple[object, ...] = ()
        self._seen: Sequence[Point] = ()
        self._trail: Sequence[Point] = ()

    def below(self, scene: MapScene, view: View, layers: Collection[str], blank: Canvas) -> Canvas:
        """Return a new canvas with the layers of a scene below the moving ones.

        `blank` is an empty canvas of the form that is wanted.
        """
        key = (view, layers, blank.ascii_only, blank.is_mono, *static_parts(scene))
        is_same = key == self._static_key
        if not is_same:
            self._static_key, self._static = key, blank
            draw_static(scene, view, blank, layers)
        self._trace(scene, view, layers, is_same=is_same)
        return self._traced.copy()

    def _trace(
        self, scene: MapScene, view: View, layers: Collection[str], *, is_same: bool
    ) -> None:
        """Draw the traces; if only echoes and trail have grown, draw only their new parts."""
        key, seen, trail = trace_parts(scene), scene.seen, scene.trail
        drawn = len(self._seen), len(self._trail)
        is_longer = is_begun_by(seen, self._seen) and is_begun_by(trail, self._trail)
        if is_same and key == self._trace_key and is_longer:
            if drawn != (len(seen), len(trail)):
                draw_traces(scene, view, self._traced, layers, drawn=drawn)
        else:
            self._trail_of_others(scene, view, layers, is_same=is_same)
            self._traced = self._trails.copy()
            draw_traces(scene, view, self._traced, layers)
        self._trace_key, self._seen, self._trail = key, seen, trail

    def _trail_of_others(
        self, scene: MapScene, view: View, layers: Collection[str], *, is_same: bool
    ) -> None:
        """Draw the trails of others above the static layers."""
        before, trails = self._other_trails, tuple(other.trail for other in scene.others)
        self._other_trails = trails
        drawn = [points_left(*pair) for pair in zip(trails, before, strict=False)]
        if is_same and len(before) == len(trails) and None not in drawn:
            known = [points for points in drawn if points is not None]
            draw_other_trails(scene, view, self._trails, layers, drawn=known)
        else:
            self._trails = self._static.copy()
            draw_other_trails(scene, view, self._trails, layers)


def is_begun_by(trail: Sequence[Point], before: Sequence[Point]) -> bool:
    """Return whether a trail has only grown."""
    return trail is before or trail[: len(before)] == before


def points_left(trail: Sequence[Point], before: Sequence[Point]) -> int | None:
    """Return how many points of a trail are left of the one before; None for another trail.

    A long one loses every other point.
    """
    if is_begun_by(trail, before):
        return len(before)
    half = before[::2]
    return len(half) if is_begun_by(trail, half) else None


def measured(start: Point, end: Point) -> str:
    """Return distance and heading from one place to another."""
    dx_m, dy_m = end[0] - start[0], end[1] - start[1]
    return f"{hypot(dx_m, dy_m):.2f} m at {degrees(atan2(dy_m, dx_m)):z.0f}°"


def described(scene: MapScene, place: Point, reach_m: float) -> str:
    """Return what is within reach of a place, and how far the robot is."""
    found = [
        *([obstacle_words(scene, place, reach_m)] if scene.obstacles else []),
        *(
            words
            for points, words in (
                (scene.seen, "echo of the last 5 s"),
                (scene.seen_late, "echo of the last 20 s"),
                (scene.seen_old, "older echo"),
                (scene.trail, "on the robot's trail"),
                (scene.hits, "hit point H"),
                (scene.leaves, "leave point L"),
            )
            if nearest_m(points, place) <= reach_m
        ),
    ]
    if scene.robot is not None:
        robot = (scene.robot.x_m, scene.robot.y_m)
        found.append(f"{measured(robot, place)} from the robot")
    return f"{place[0]:zg} {place[1]:zg}: {', '.join(found) or 'nothing known'}"


def obstacle_words(scene: MapScene, place: Point, reach_m: float) -> str:
    """Return whether a place is in an obstacle, else how far the nearest one is."""
    name = "obstacle" if scene.truth else "seen obstacle"
    if any(is_inside(shape, place) for shape in scene.obstacles[1:]):
        return f"in an {name}" if scene.truth else f"in a {name}"
    away_m = min(shape_distance_m(shape, place) for shape in scene.obstacles)
    return f"{'at an' if away_m <= reach_m else 'nearest'} {name} {away_m:.2f} m away"


def nearest_m(points: Iterable[Point], place: Point) -> float:
    """Return the distance to the nearest point; inf without points."""
    return min((hypot(x_m - place[0], y_m - place[1]) for x_m, y_m in points), default=inf)


def shape_distance_m(shape: Shape, place: Point) -> float:
    """Return the distance from a place to the edge of a shape."""
    if not isinstance(shape, Outline):
        return abs(hypot(shape.x_m - place[0], shape.y_m - place[1]) - shape.radius_m)
    points = shape.points_m
    ends = (*points, points[0]) if shape.closed and points else points
    return min((segment_m(start, end, place) for start, end in pairwise(ends)), default=inf)


def segment_m(start: Point, end: Point, place: Point) -> float:
    """Return the distance from a place to a segment."""
    dx_m, dy_m = end[0] - start[0], end[1] - start[1]
    px_m, py_m = place[0] - start[0], place[1] - start[1]
    length = dx_m * dx_m + dy_m * dy_m
    share = max(0.0, min(1.0, (px_m * dx_m + py_m * dy_m) / length)) if length else 0.0
    return hypot(px_m - share * dx_m, py_m - share * dy_m)


def is_inside(shape: Shape, place: Point) -> bool:
    """Return whether a place is inside a closed shape."""
    if not isinstance(shape, Outline):
        return hypot(shape.x_m - place[0], shape.y_m - place[1]) < shape.radius_m
    return shape.closed and crossings(shape.points_m, place) % 2 == 1


def crossings(points: Sequence[Point], place: Point) -> int:
    """Return how many edges a ray from a place to the right crosses."""
    x_m, y_m = place
    edges = pairwise((*points, points[0])) if points else ()
    return sum(
        (y1 > y_m) != (y2 > y_m) and x_m < x1 + (y_m - y1) * (x2 - x1) / (y2 - y1)
        for (x1, y1), (x2, y2) in edges
    )
