"""The scene to draw: a room with 14 obstacles, and a robot with a long trail."""

from collections.abc import Iterable
from math import atan2, cos, sin
from typing import Final

from ground.map.canvas import Canvas, Dot
from ground.map.drawing import draw
from ground.map.scene import Disc, MapScene, MapTarget, Outline, RobotMark, Shape, floor
from ground.map.view import Point, View

TRAIL_POINTS: Final = 360
SIZE_M: Final = (10.0, 8.0)
BOX_M: Final = 0.6
RADIUS_M: Final = 0.12
DISCS: Final = (Disc(7.6, 2.0, 0.35), Disc(8.2, 5.0, 0.5))
RANGES_M: Final = (0.4, 0.7, 1.1, 1.6, 2.2, 1.3, 0.9, 0.5)


class RecordingCanvas(Canvas):
    """A canvas that records its lines, so that another widget can draw the same."""

    def __init__(self, columns: int, rows: int) -> None:
        super().__init__(columns, rows)
        self.polylines: list[tuple[str, list[Dot]]] = []

    def polyline(self, dots: Iterable[Dot], role: str) -> None:
        """Record and draw a line."""
        recorded_canvas = list(dots)
        self.polylines.append((role, recorded_canvas))
        super().polyline(recorded_canvas, role)


def driving_trails(count: int) -> list[MapScene]:
    """Return scenes of a drive: the trail grows by one step per frame."""
    way = [_place(step, 0.0) for step in range(TRAIL_POINTS + count)]
    obstacles = _obstacles()
    return [_scene(tuple(way[i : i + TRAIL_POINTS]), obstacles) for i in range(count)]


def moving_trails(count: int) -> list[MapScene]:
    """Return the most expensive scenes: the whole trail moves with each frame."""
    obstacles = _obstacles()
    return [
        _scene(tuple(_place(step, 0.03 * i) for step in range(TRAIL_POINTS)), obstacles)
        for i in range(count)
    ]


def recorded_canvas(scene: MapScene, columns: int, rows: int) -> RecordingCanvas:
    """Draw a scene and return its lines in dots."""
    canvas = RecordingCanvas(columns, rows)
    draw(scene, View.fit(scene.box(), columns, rows), canvas)
    return canvas


def segments(canvas: RecordingCanvas) -> int:
    """Return the number of line segments."""
    return sum(len(dots) - 1 for _, dots in canvas.polylines if dots)


def _scene(trail: tuple[Point, ...], obstacles: tuple[Shape, ...]) -> MapScene:
    (before_x_m, before_y_m), (x_m, y_m) = trail[-2:]
    heading_rad = atan2(y_m - before_y_m, x_m - before_x_m)
    return MapScene(
        size_m=SIZE_M,
        obstacles=obstacles,
        trail=trail,
        robot=RobotMark(x_m, y_m, heading_rad, RADIUS_M),
        covariance=(0.02, 0.008, 0.01),
        ranges_m=RANGES_M,
        zone_m=0.3,
        goal=MapTarget(9.2, 7.2, 0.5, 0.1),
        virtual_goal=(x_m + 2.0 * cos(heading_rad), y_m + 2.0 * sin(heading_rad)),
    )


def _place(step: int, phase_rad: float) -> Point:
    x_rad, y_rad = 0.0131 * step + phase_rad, 0.0217 * step + 0.4
    return 5.0 + 4.4 * sin(x_rad), 4.0 + 3.4 * sin(y_rad)


def _obstacles() -> tuple[Shape, ...]:
    corners = [(1.0 + 1.6 * column, 1.0 + 2.2 * row) for column in range(4) for row in range(3)]
    boxes = [
        Outline(((x, y), (x + BOX_M, y), (x + BOX_M, y + BOX_M), (x, y + BOX_M)))
        for x, y in corners
    ]
    return (Outline(floor(SIZE_M)), *boxes, *DISCS)
