"""Draw a run: turn each message into the messages that a viewer draws.

All poses are in the frame `world`, because the robot knows its start pose. Values that are not
finite are not drawn.
"""

from collections.abc import Callable
from math import cos, isfinite, radians, sin
from typing import Any, Final, NamedTuple, TypeVar

from ground.recording import foxglove_schemas
from ground.recording.foxglove_schemas import (
    LINE_LIST,
    LINE_LOOP,
    Json,
    Point,
    arrow,
    ball,
    cloud,
    disc,
    entity,
    line,
    pose,
    scene,
    stamp,
    turn,
    vector,
)
from ground.recording.world_metadata import solids, world_of
from protocol.ring import BEARINGS_RAD, RADIUS_M
from protocol.topics import MARK, path_of
from protocol.wire.enums import Severity
from protocol.wire.message import Message
from protocol.wire.messages import (
    AvoidanceDecision,
    GroundTruth,
    NavigatorStatus,
    PlanarOdometry,
    SonarScan,
    Statustext,
)
from protocol.wire.statustext import StatustextAssembler
from protocol.world import World

M = TypeVar("M", bound=Message)
WORLD: Final = "world"
ROBOT: Final = "robot"
TRAIL_STEP_M: Final = 0.05
TRAIL_EVERY_NS: Final = 1_000_000_000
MAX_POSES: Final = 400
RING: Final = tuple((cos(radians(a)), sin(radians(a))) for a in range(0, 360, 15))
BLUE = (0.2, 0.5, 1.0, 1.0)
GREEN = (0.1, 0.7, 0.3, 1.0)
YELLOW = (0.9, 0.7, 0.1, 0.8)
GREY = (0.55, 0.58, 0.62, 1.0)
LEVELS: Final = {
    Severity.DEBUG: 1,
    Severity.INFO: 2,
    Severity.NOTICE: 2,
    Severity.WARNING: 3,
    Severity.ERROR: 4,
}
FATAL: Final = 5
MAX_SENDERS: Final = 64


class ViewerMessage(NamedTuple):
    """A message for a viewer: topic, name of its schema, content."""

    topic: str
    shape: str
    content: Json


class SceneDrawer:
    """Draws messages; keeps what later drawings need: the trail, the goal, the robot's size."""

    def __init__(self) -> None:
        self._radius_m = RADIUS_M
        self._trail: list[tuple[float, float, float]] = []
        self._step_m = TRAIL_STEP_M
        self._trail_due_ns = 0
        self._goal: tuple[float, float, float] | None = None
        self._virtual: Point | None = None
        self._texts: dict[str, StatustextAssembler] = {}
        self._draws: dict[type[Message], Callable[[Any, int], list[ViewerMessage]]] = {
            PlanarOdometry: self._odometry,
            GroundTruth: self._truth,
            SonarScan: self._sonar,
            NavigatorStatus: self._status,
            AvoidanceDecision: self._decision,
        }

    def draw(self, key: str, message: Message, time_ns: int) -> list[ViewerMessage]:
        """Return the drawings of a message."""
        if isinstance(message, Statustext):
            return self._text(key, message, time_ns)
        draw = self._draws.get(type(message))
        return [] if draw is None else draw(message, time_ns)

    def draw_fact(self, name: str, text: str, time_ns: int) -> list[ViewerMessage]:
        """Draw a fact, which is the world with the robot; a malformed one draws nothing."""
        if name != WORLD:
            return []
        world = world_of(text)
        return [] if world is None else self._world(world, time_ns)

    def _world(self, world: World, time_ns: int) -> list[ViewerMessage]:
        self._radius_m, start = world.radius_m, world.start
        cubes, cylinders = solids(world, GREY)
        walls = entity("walls", WORLD, time_ns, cubes=cubes, cylinders=cylinders)
        ways = [arrow((start.x_m, start.y_m), start.heading_rad, 0.3, GREY)]
        begin = entity("start", WORLD, time_ns, arrows=ways)
        body = [disc((0.0, 0.0), self._radius_m, 0.1, BLUE)]
        ahead = [arrow((0.0, 0.0), 0.0, 2.0 * self._radius_m, BLUE)]
        robot = entity("robot", ROBOT, time_ns, cylinders=body, arrows=ahead)
        return [
            ViewerMessage("/world", foxglove_schemas.SCENE_UPDATE, scene(walls, begin)),
            ViewerMessage("/robot/body", foxglove_schemas.SCENE_UPDATE, scene(robot)),
        ]

    def _odometry(self, odometry: PlanarOdometry, time_ns: int) -> list[ViewerMessage]:
        place = (odometry.x_m, odometry.y_m, odometry.heading_rad)
        if not all(map(isfinite, place)):
            return []
        found = [_transform(place, time_ns), _pose("/robot/pose", place, time_ns)]
        self._extend_trail(*place)
        if time_ns >= self._trail_due_ns:
            self._trail_due_ns = time_ns + TRAIL_EVERY_NS
            poses = [pose(*known) for known in self._trail]
            content: Json = {"timestamp": stamp(time_ns), "frame_id": WORLD, "poses": poses}
            found.append(ViewerMessage("/robot/trail", foxglove_schemas.POSES_IN_FRAME, content))
        return found

    def _extend_trail(self, x_m: float, y_m: float, heading_rad: float) -> None:
        """Keep a bounded trail: when it is full, drop every other pose."""
        if self._trail:
            last_x_m, last_y_m, _ = self._trail[-1]
            if (x_m - last_x_m) ** 2 + (y_m - last_y_m) ** 2 < self._step_m**2:
                return
        self._trail.append((x_m, y_m, heading_rad))
        if len(self._trail) > MAX_POSES:
            self._trail = self._trail[::2]
            self._step_m *= 2.0

    def _truth(self, truth: GroundTruth, time_ns: int) -> list[ViewerMessage]:
        place = (truth.x_m, truth.y_m, truth.heading_rad)
        return [_pose("/truth/pose", place, time_ns)] if all(map(isfinite, place)) else []

    def _sonar(self, scan: SonarScan, time_ns: int) -> list[ViewerMessage]:
        """Draw each echo as a point with a ray; draw nothing for a sonar without echo."""
        points: list[Point] = []
        rays: list[Point] = []
        for sonar, bearing_rad in enumerate(BEARINGS_RAD):
            if not scan.echo & scan.valid & 1 << sonar:
                continue
            ahead, aside = cos(bearing_rad), sin(bearing_rad)
            far_m = self._radius_m + scan.range_mm[sonar] / 1000.0
            points.append((far_m * ahead, far_m * aside))
            rays += [(self._radius_m * ahead, self._radius_m * aside), points[-1]]
        seen = entity("rays", ROBOT, time_ns, lines=[line(LINE_LIST, rays, 0.01, YELLOW)])
        return [
            ViewerMessage(
                "/sonar/echoes", foxglove_schemas.POINT_CLOUD, cloud(ROBOT, time_ns, points)
            ),
            ViewerMessage("/sonar/rays", foxglove_schemas.SCENE_UPDATE, scene(seen)),
        ]

    def _status(self, status: NavigatorStatus, time_ns: int) -> list[ViewerMessage]:
        """Draw the goal when it has changed."""
        goal = (status.goal_x_m, status.goal_y_m, status.goal_heading_rad)
        if not (isfinite(goal[0]) and isfinite(goal[1])) or str(goal) == str(self._goal):
            return []
        self._goal = goal
        centre, heading_rad = goal[:2], goal[2]
        spot = [disc(centre, 0.1, 0.02, GREEN)]
        ways = [arrow(centre, heading_rad, 0.4, GREEN)] if isfinite(heading_rad) else []
        mark = entity("goal", WORLD, time_ns, cylinders=spot, arrows=ways)
        return [ViewerMessage("/goal", foxglove_schemas.SCENE_UPDATE, scene(mark))]

    def _decision(self, decision: AvoidanceDecision, time_ns: int) -> list[ViewerMessage]:
        """Draw the virtual goal and the avoidance zone; an empty entity clears them."""
        spot = (decision.virtual_x_m, decision.virtual_y_m)
        virtual = spot if isfinite(spot[0]) and isfinite(spot[1]) else None
        if virtual == self._virtual:
            return []
        self._virtual = virtual
        balls = [] if virtual is None else [ball(virtual, 0.06, BLUE)]
        reach_m = self._radius_m + decision.zone_m
        rings = []
        if isfinite(reach_m) and virtual is not None:
            points = [(reach_m * x, reach_m * y) for x, y in RING]
            rings.append(line(LINE_LOOP, points, 0.01, BLUE))
        spheres = entity("virtual", WORLD, time_ns, spheres=balls)
        zone = entity("zone", ROBOT, time_ns, lines=rings)
        return [ViewerMessage("/goal/virtual", foxglove_schemas.SCENE_UPDATE, scene(spheres, zone))]

    def _texts_of(self, key: str) -> StatustextAssembler:
        """Return the text assembler of one sender; drop the oldest beyond the limit."""
        texts = self._texts.setdefault(key, StatustextAssembler())
        if len(self._texts) > MAX_SENDERS:
            del self._texts[next(iter(self._texts))]
        return texts

    def _text(self, key: str, text: Statustext, time_ns: int) -> list[ViewerMessage]:
        """Draw a text of the robot or an operator; pieces of several texts may interleave."""
        words = self._texts_of(key).receive(text)
        if not words:
            return []
        content: Json = {
            "timestamp": stamp(time_ns),
            "level": LEVELS.get(Severity(min(text.severity, Severity.DEBUG)), FATAL),
            "message": words,
            "name": MARK.path if path_of(key) == MARK.path else ROBOT,
            "file": "",
            "line": 0,
        }
        return [ViewerMessage("/log", foxglove_schemas.LOG, content)]


def _pose(topic: str, place: tuple[float, float, float], time_ns: int) -> ViewerMessage:
    content: Json = {"timestamp": stamp(time_ns), "frame_id": WORLD, "pose": pose(*place)}
    return ViewerMessage(topic, foxglove_schemas.POSE_IN_FRAME, content)


def _transform(place: tuple[float, float, float], time_ns: int) -> ViewerMessage:
    content: Json = {
        "timestamp": stamp(time_ns),
        "parent_frame_id": WORLD,
        "child_frame_id": ROBOT,
        "translation": vector(place[0], place[1]),
        "rotation": turn(place[2]),
    }
    return ViewerMessage("/tf", foxglove_schemas.FRAME_TRANSFORM, content)
