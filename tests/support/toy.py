"""A robot that follows commands at once, among discs and walls: enough to close the loop."""

from collections.abc import Callable
from dataclasses import dataclass, field
from math import cos, hypot, inf, pi, sin

from robot.core import brain, modes, states
from robot.core.parameters import DEFAULTS, Params
from robot.core.values import Goal, Inputs, Outputs, Scan, Wheels
from runtime.units import PERIOD_MS

RAYS = 7

Point = tuple[float, float]
Wall = tuple[Point, Point]


def polygon(*corners: Point) -> tuple[Wall, ...]:
    return tuple(zip(corners, (*corners[1:], corners[0]), strict=True))


def box(x_m: float, y_m: float, width_m: float, height_m: float) -> tuple[Wall, ...]:
    right, top = x_m + width_m, y_m + height_m
    return polygon((x_m, y_m), (right, y_m), (right, top), (x_m, top))


@dataclass
class Toy:
    """Discs (x, y, radius) and walls around a differential drive with ideal sonars."""

    discs: tuple[tuple[float, float, float], ...] = ()
    walls: tuple[Wall, ...] = ()
    x_m: float = 0.0
    y_m: float = 0.0
    heading_rad: float = 0.0
    left_m: float = 0.0
    right_m: float = 0.0
    clearance_m: float = inf
    params: Params = field(default_factory=lambda: DEFAULTS)

    def drive(self, outputs: Outputs) -> None:
        rim_m = self.params.wheel_radius_m * 1e-3 * self.params.period_s
        left_m, right_m = outputs.left_mrad_s * rim_m, outputs.right_mrad_s * rim_m
        turn_rad = (right_m - left_m) / self.params.track_m
        middle_rad = self.heading_rad + 0.5 * turn_rad
        self.x_m += 0.5 * (left_m + right_m) * cos(middle_rad)
        self.y_m += 0.5 * (left_m + right_m) * sin(middle_rad)
        self.heading_rad += turn_rad
        self.left_m += left_m
        self.right_m += right_m
        self.clearance_m = min(self.clearance_m, self.clearance_now_m())

    def wheels(self, at_ms: int) -> Wheels:
        per_m = 1.0 / self.params.m_per_tick
        return Wheels(round(self.left_m * per_m), round(self.right_m * per_m), 0, at_ms)

    def scan(self) -> Scan:
        ranges_m = [self.sonar_m(i) for i in range(8)]
        echo = sum(1 << i for i, range_m in enumerate(ranges_m) if range_m <= 3.0)
        range_mm = tuple(max(20, round(r * 1000)) if r <= 3.0 else 0 for r in ranges_m)
        return Scan(range_mm, (25, 0) * 4, 0xFF, echo)

    def sonar_m(self, i: int) -> float:
        middle_rad = self.heading_rad + (i - 3.5) * pi / 8
        spread = [pi / 8 * (k / (RAYS - 1) - 0.5) for k in range(RAYS)]
        return min(self.ray_m(middle_rad + offset_rad) for offset_rad in spread)

    def ray_m(self, angle_rad: float) -> float:
        ux, uy = cos(angle_rad), sin(angle_rad)
        hits = [self.disc_m(disc, ux, uy) for disc in self.discs]
        hits += [self.wall_m(wall, ux, uy) for wall in self.walls]
        return min(hits, default=inf) - self.params.radius_m

    def disc_m(self, disc: tuple[float, float, float], ux: float, uy: float) -> float:
        dx_m, dy_m, radius_m = disc[0] - self.x_m, disc[1] - self.y_m, disc[2]
        along_m = dx_m * ux + dy_m * uy
        root = radius_m**2 - (dx_m * uy - dy_m * ux) ** 2
        return along_m - root**0.5 if along_m > 0 and root >= 0 else inf

    def wall_m(self, wall: Wall, ux: float, uy: float) -> float:
        (ax, ay), (bx, by) = wall
        wx, wy, dx, dy = bx - ax, by - ay, ax - self.x_m, ay - self.y_m
        cross = ux * wy - uy * wx
        if cross == 0.0:
            return inf
        along_m, share = (dx * wy - dy * wx) / cross, (dx * uy - dy * ux) / cross
        return along_m if along_m >= 0.0 and 0.0 <= share <= 1.0 else inf

    def clearance_now_m(self) -> float:
        near = [hypot(x - self.x_m, y - self.y_m) - r for x, y, r in self.discs]
        near += [self.wall_distance_m(wall) for wall in self.walls]
        return min(near, default=inf) - self.params.radius_m

    def wall_distance_m(self, wall: Wall) -> float:
        (ax, ay), (bx, by) = wall
        wx, wy, dx, dy = bx - ax, by - ay, self.x_m - ax, self.y_m - ay
        share = min(1.0, max(0.0, (dx * wx + dy * wy) / (wx * wx + wy * wy)))
        return hypot(dx - share * wx, dy - share * wy)


def drive_to(
    toy: Toy,
    goal: Goal,
    navigator: int = states.VGM,
    side: int = states.LEFT,
    limit_s: float = 120.0,
    each: Callable[[brain.State, Outputs], None] = lambda state, outputs: None,
) -> brain.State:
    """Arm, send the goal between the first two ticks, and drive until the goal has ended."""
    state = brain.State(toy.params)
    for tick in range(int(limit_s * 1000) // PERIOD_MS):
        now_ms = tick * PERIOD_MS
        inputs = Inputs(now_ms, toy.wheels(now_ms), toy.scan(), None)
        state, outputs = brain.step(state, inputs, toy.params)
        each(state, outputs)
        if tick == 0:
            assert modes.set_navigator(state.machine, navigator, side) == 0
            assert modes.arm(state.machine) == 0
            assert modes.goto(state.machine, goal, states.AUTO, now_ms) == 0
        elif state.machine.goal_state >= states.REACHED:
            break
        toy.drive(outputs)
    return state
