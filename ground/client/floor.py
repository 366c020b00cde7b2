"""The floor of the plant's world and its goal.

Goals outside of the floor or in obstacles are refused.
"""

import re
from math import hypot
from typing import Final, NamedTuple

from ground.client.goal import Destination
from ground.missions.mission import inside
from protocol.bus.bus import Bus
from protocol.topics import WORLD
from protocol.world import World, WorldCircle, WorldPolygon, world_in
from runtime.errors import RemoteError, UserError

EXAMPLE: Final = "example: goto 2 1.5"
FOLLOWER: Final = re.compile(r"r(?!1\Z)\d+\Z")
"""Names that `up` gives to additional robots."""


class Floor(NamedTuple):
    """The name of a world and the size of its floor, from 0 0, with the obstacles that stand on it.

    Obstacles that move, and thin walls, are left out.
    """

    world: str
    width_m: float
    height_m: float
    obstacles: tuple[WorldCircle | WorldPolygon, ...] = ()

    def refuse_outside(self, what: str, x_m: float, y_m: float, fix: str = "") -> None:
        """Raise UserError for a place outside of the floor or in an obstacle; `what` names it."""
        if not (0.0 <= x_m <= self.width_m and 0.0 <= y_m <= self.height_m):
            size = f"{self.width_m:g} x {self.height_m:g} m"
            raise UserError(f"{what} lies outside the world {self.world} ({size}){fix}")
        if any(covers(one, x_m, y_m) for one in self.obstacles):
            raise UserError(f"{what} lies in an obstacle of the world {self.world}{fix}")


def covers(obstacle: WorldCircle | WorldPolygon, x_m: float, y_m: float) -> bool:
    """Return whether a place is within an obstacle."""
    if isinstance(obstacle, WorldCircle):
        return hypot(x_m - obstacle.x_m, y_m - obstacle.y_m) < obstacle.radius_m
    return inside(obstacle.points_m, (x_m, y_m))


def floor_from(world: World) -> Floor:
    """Return the floor of a world."""
    solid = (one for one in world.obstacles if isinstance(one, WorldCircle | WorldPolygon))
    still = tuple(one for one in solid if isinstance(one, WorldPolygon) or not one.path_m)
    return Floor(world.name, *world.size_m, still)


def floor_in(text: str | bytes) -> Floor | None:
    """Return the floor in the plant's description of its world; None if it is malformed."""
    try:
        return floor_from(world_in(text))
    except ValueError:
        return None


def goal_in(world: World) -> Destination:
    """Return the goal of the world."""
    goal = world.goal
    return Destination(
        x_m=goal.x_m,
        y_m=goal.y_m,
        heading_rad=goal.heading_rad,
        position_tolerance_m=goal.position_tolerance_m,
        heading_tolerance_rad=goal.heading_tolerance_rad,
    )


def world_goal(bus: Bus, robot: str) -> Destination:
    """Ask the plant for the goal of its world; UserError if this robot has none.

    Of several robots `up` sends only r1 there, and the others beside it.
    """
    try:
        answer = bus.ask(WORLD, robot=robot)
        goal = goal_in(world_in(answer if isinstance(answer, bytes) else b""))
    except (RemoteError, ValueError):
        raise UserError(
            f"X Y is missing, and there is no simulation with a goal; {EXAMPLE}"
        ) from None
    if FOLLOWER.match(robot):
        raise UserError(f"X Y is missing: the world's goal {goal} is that of r1; {EXAMPLE}")
    return goal


def floor_of(bus: Bus, robot: str) -> Floor | None:
    """Ask the plant for its world; None without a simulation, or without the right to ask."""
    try:
        answer = bus.ask(WORLD, robot=robot)
    except RemoteError:
        return None
    return floor_in(answer) if isinstance(answer, bytes) else None
