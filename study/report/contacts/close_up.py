"""A drawing of the last seconds before a contact, about a metre and a half wide."""

from collections.abc import Sequence
from math import cos, sin
from typing import Final

from plant.model.geometry import clearance_m
from plant.model.types import Circle, Point, Polygon, World
from study.report.charts.style import colour
from study.report.charts.svg import Dot, SvgDrawing
from study.report.charts.world_map import simplified, wall_parts
from study.report.contacts.kinds import seen_from
from study.report.contacts.recorder import Tick
from study.report.contacts.touched import Touched, world_at

WIDTH: Final = 300.0
WIDE_M: Final = 1.5
BAR_M: Final = 0.1
SCALE: Final = WIDTH / WIDE_M
CROSS: Final = 5.0
POINT: Final = 1.8
RIM: Final = 10.0


class CloseUp:
    """A square of the world around the robot at the contact; metres to pixels, y upwards."""

    def __init__(self, centre: Point, title: str) -> None:
        self._left, self._top = centre[0] - WIDE_M / 2.0, centre[1] + WIDE_M / 2.0
        self._centre = centre
        self.drawing = SvgDrawing(WIDTH, WIDTH, title)

    def at(self, point: Point) -> Dot:
        """Return the pixel of a point in metres."""
        return (point[0] - self._left) * SCALE, (self._top - point[1]) * SCALE

    def ground(self, world: World) -> None:
        """Draw the floor and the obstacles that reach into the square."""
        width_m, height_m = world.size_m
        kind = "rim" if world.walls else "ground"
        self.drawing.rectangle(self.at((0.0, height_m)), width_m * SCALE, height_m * SCALE, kind)
        for obstacle in world.obstacles:
            if clearance_m(self._centre, obstacle) > WIDE_M:
                continue
            if isinstance(obstacle, Circle):
                kind = "mover" if obstacle.path_m else "solid"
                centre = self.at((obstacle.x_m, obstacle.y_m))
                self.drawing.circle(centre, obstacle.radius_m * SCALE, kind)
            elif isinstance(obstacle, Polygon):
                self.drawing.polygon(map(self.at, obstacle.points_m), "solid")
            else:
                half = max(0.5, obstacle.thickness_m * SCALE / 2.0)
                wall_parts(self.drawing, [self.at(point) for point in obstacle.points_m], half)

    def robot(self, end: Tick, radius_m: float) -> None:
        """Draw the robot at the contact, with its heading."""
        x_m, y_m, heading_rad = end.true
        tip = x_m + radius_m * cos(heading_rad), y_m + radius_m * sin(heading_rad)
        self.drawing.circle(self.at((x_m, y_m)), radius_m * SCALE, "goal")
        self.drawing.line(self.at((x_m, y_m)), self.at(tip), "goal")

    def memory(self, tick: Tick) -> None:
        """Draw the stored points where the robot estimated them, seen from its true pose."""
        x_m, y_m, heading_rad = tick.true
        for point in tick.points:
            ahead, left = seen_from(tick.estimated, (point.x_m, point.y_m))
            true = (
                x_m + ahead * cos(heading_rad) - left * sin(heading_rad),
                y_m + ahead * sin(heading_rad) + left * cos(heading_rad),
            )
            self.drawing.circle(self.at(true), POINT, "start" if point.counts else "doubt")

    def cross(self, place: Point) -> None:
        """Mark the touched place, and draw a bar of ten centimetres in a corner."""
        x, y = self.at(place)
        self.drawing.line((x - CROSS, y - CROSS), (x + CROSS, y + CROSS), "cross")
        self.drawing.line((x - CROSS, y + CROSS), (x + CROSS, y - CROSS), "cross")
        low = WIDTH - RIM
        self.drawing.line((RIM, low), (RIM + BAR_M * SCALE, low), "axis")
        self.drawing.text((RIM + BAR_M * SCALE + 5.0, low + 3.5), "0.1 m", "small")


def close_up(
    world: World, ticks: Sequence[Tick], place: Touched, radius_m: float, title: str
) -> SvgDrawing:
    """Draw the surroundings, the true way of the kept ticks, the memory and the touched place."""
    end = ticks[-1]
    plan = CloseUp(end.true[:2], title)
    plan.ground(world_at(world, end.time_s))
    way = [plan.at(point) for point in simplified([tick.true for tick in ticks])]
    plan.drawing.polyline(way, f"way l-{colour('vgm_memory')}")
    plan.memory(ticks[-2] if len(ticks) > 1 else end)
    plan.robot(end, radius_m)
    plan.cross(place.point)
    return plan.drawing
