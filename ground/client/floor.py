"""The floor of the plant's world and its goal.

Goals outside of the floor or in obstacles are refused.
"""

import re
from collections.abc import Mapping
from math import hypot, isfinite, radians
from typing import Any, Final, NamedTuple, TypeAlias

from ground.client.goal import Destination
from ground.client.link import Link
from ground.missions.mission import inside
from protocol.topics import WORLD
from runtime.cli.terminal import printable
from runtime.errors import RemoteError, UserError
from runtime.files import value_in

EXAMPLE: Final = "example: goto 2 1.5"
FOLLOWER: Final = re.compile(r"r(?!1\Z)\d+\Z")
"""Names that `up` gives to additional robots."""


class Circle(NamedTuple):
    """A round obstacle."""

    x_m: float
    y_m: float
    radius_m: float


Outline: TypeAlias = tuple[tuple[float, float], ...]


class Floor(NamedTuple):
    """The name of a world and the size of its floor, from 0 0, with the obstacles that stand on it.

    Obstacles that move, and thin walls, are left out.
    """

    world: str
    width_m: float
    height_m: float
    obstacles: tuple[Circle | Outline, ...] = ()

    def refuse_outside(self, what: str, x_m: float, y_m: float, fix: str = "") -> None:
        """Raise UserError for a place outside of the floor or in an obstacle; `what` names it."""
        if not (0.0 <= x_m <= self.width_m and 0.0 <= y_m <= self.height_m):
            size = f"{self.width_m:g} x {self.height_m:g} m"
            raise UserError(f"{what} lies outside the world {self.world} ({size}){fix}")
        if any(covers(one, x_m, y_m) for one in self.obstacles):
            raise UserError(f"{what} lies in an obstacle of the world {self.world}{fix}")


def covers(obstacle: Circle | Outline, x_m: float, y_m: float) -> bool:
    """Return whether a place is within an obstacle."""
    if isinstance(obstacle, Circle):
        return hypot(x_m - obstacle.x_m, y_m - obstacle.y_m) < obstacle.radius_m
    return inside(obstacle, (x_m, y_m))


def floor_from(facts: Mapping[str, Any]) -> Floor:
    """Return the floor of a world; ValueError, TypeError or KeyError for malformed facts."""
    width_m, height_m = map(float, facts["size_m"])
    obstacles: list[Circle | Outline] = []
    for one in facts.get("obstacles", ()):
        if "polygon_m" in one:
            obstacles.append(tuple((float(x_m), float(y_m)) for x_m, y_m in one["polygon_m"]))
        elif "circle_m" in one and "path_m" not in one:
            circle = one["circle_m"]
            obstacles.append(
                Circle(float(circle["x"]), float(circle["y"]), float(circle["radius"]))
            )
    return Floor(printable(str(facts["name"])), width_m, height_m, tuple(obstacles))


def floor_in(text: str | bytes) -> Floor | None:
    """Return the floor in the plant's description of its world; None if it is malformed."""
    try:
        return floor_from(value_in(text if isinstance(text, str) else text.decode()))
    except (ValueError, TypeError, KeyError, AttributeError):
        return None


def goal_in(facts: dict[str, Any]) -> Destination:
    """Return the goal of the world."""
    goal = facts["goal"]
    heading_deg = goal["heading_deg"]
    return Destination(
        x_m=goal["x_m"],
        y_m=goal["y_m"],
        heading_rad=None if heading_deg is None else radians(heading_deg),
        position_tolerance_m=goal["position_tolerance_m"],
        heading_tolerance_rad=radians(goal["heading_tolerance_deg"]),
    )


def world_goal(link: Link) -> Destination:
    """Ask the plant for the goal of its world; UserError if this robot has none.

    Of several robots `up` sends only r1 there, and the others beside it.
    """
    try:
        answer = link.bus.ask(WORLD, robot=link.robot)
        goal = goal_in(value_in(answer.decode() if isinstance(answer, bytes) else ""))
        known = all(map(isfinite, (goal.x_m, goal.y_m)))
    except (RemoteError, ValueError, TypeError, KeyError, AttributeError):
        known = False
    if not known:
        raise UserError(f"X Y is missing, and there is no simulation with a goal; {EXAMPLE}")
    if FOLLOWER.match(link.robot):
        raise UserError(f"X Y is missing: the world's goal {goal} is that of r1; {EXAMPLE}")
    return goal


def floor_of(link: Link) -> Floor | None:
    """Ask the plant for its world; None without a simulation, or without the right to ask."""
    try:
        answer = link.bus.ask(WORLD, robot=link.robot)
    except RemoteError:
        return None
    return floor_in(answer) if isinstance(answer, bytes) else None
