"""Describe a mission: its steps in order, and the fence around them; list the problems of both.

Positions are metres in the robot's own frame, x forward and y left of its start pose. Headings are
degrees, counter-clockwise from x. A fence has at least three distinct corners, without crossing
sides.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import combinations
from math import dist
from typing import Annotated, Final, NamedTuple, TypeAlias

from msgspec import Meta

from protocol.wire.enums import Command
from runtime.errors import UserError
from runtime.toml_reader import Key

FARTHEST_M = 200_000.0  # what fits the wire; the robot's own limit is nearer
LOOSEST_M = 1.0  # the largest tolerance of a position

Coordinate: TypeAlias = Annotated[float, Meta(ge=-FARTHEST_M, le=FARTHEST_M)]
Heading: TypeAlias = Annotated[float, Meta(ge=-360.0, le=360.0)]
Corner: TypeAlias = tuple[Coordinate, Coordinate]


@dataclass(frozen=True, kw_only=True)
class MavlinkItem:
    """An item as MAVLink has it, in every field: a step of a mission that has no place.

    `params` are MAVLink's seven. A waypoint that came as such an item keeps it, without the place,
    so that it reads back as it was written.
    """

    command: Annotated[int, Meta(ge=0, le=65_535)]
    frame: Annotated[int, Meta(ge=0, le=255)]
    params: tuple[float, float, float, float, float, float, float]
    autocontinue: bool = True

    def __str__(self) -> str:
        first, second = self.params[:2]
        match self.command:
            case Command.NAV_DELAY:
                return f"wait {first:g} s"
            case Command.DO_CHANGE_SPEED if second >= 0.0:
                return f"speed {second:g} m/s"
            case Command.DO_CHANGE_SPEED:
                return "same speed" if second == -1.0 else "usual speed"
            case Command.DO_JUMP:
                return f"jump to item {first:g}, {second:g} time{'' if second == 1.0 else 's'}"
            case Command.NAV_RETURN_TO_LAUNCH:
                return "return to the start"
            case _:
                return f"command {self.command}"


@dataclass(frozen=True, kw_only=True)
class Waypoint:
    """A pose to drive to, with a wait of `hold_s`; heading None allows any.

    `mavlink` is the item of another program that it was, from which the other values follow.
    """

    x_m: Coordinate
    y_m: Coordinate
    heading_deg: Heading | None = None
    position_tolerance_m: Annotated[float, Meta(ge=0.005, le=LOOSEST_M)] = 0.05
    heading_tolerance_deg: Annotated[float, Meta(ge=0.2, le=180.0)] = 3.0
    hold_s: Annotated[float, Meta(ge=0.0, le=86_400.0)] = 0.0
    mavlink: MavlinkItem | None = field(default=None, compare=False)

    @property
    def stays(self) -> bool:
        """True if the robot stays here until an operator leads it on."""
        return self.mavlink is not None and self.mavlink.command == Command.NAV_LOITER_UNLIM

    def __str__(self) -> str:
        heading = "" if self.heading_deg is None else f" at {self.heading_deg:g} deg"
        hold = f", hold {self.hold_s:g} s" if self.hold_s else ", stay" if self.stays else ""
        return f"({self.x_m:g}, {self.y_m:g}){heading}{hold}"


Step: TypeAlias = Waypoint | MavlinkItem


@dataclass(frozen=True, kw_only=True)
class Circle:
    """A fence: the robot stays within this distance of a point."""

    x_m: Coordinate
    y_m: Coordinate
    radius_m: Annotated[float, Meta(gt=0.0, le=FARTHEST_M)]

    def __str__(self) -> str:
        return f"circle of {self.radius_m:g} m around ({self.x_m:g}, {self.y_m:g})"


@dataclass(frozen=True, kw_only=True)
class Polygon:
    """A fence: the robot stays inside these corners."""

    corners: tuple[Corner, ...]

    def __str__(self) -> str:
        return f"polygon of {len(self.corners)} corners"


Outline: TypeAlias = Circle | Polygon


@dataclass(frozen=True, kw_only=True)
class Zones:
    """A fence of several outlines: the robot stays inside `outline` and out of each exclusion.

    `drawn_after` is the number of exclusions that were drawn before the outline.
    """

    outline: Outline
    exclusions: tuple[Outline, ...]
    drawn_after: int = 0

    def __str__(self) -> str:
        out = " and ".join(map(str, self.exclusions))
        return f"out of {out}" if self.outline == EVERYWHERE else f"{self.outline}, out of {out}"

    @property
    def drawn(self) -> tuple[tuple[bool, Outline], ...]:
        """The outlines in the order in which they were drawn; True for the one to stay inside."""
        out = [(False, one) for one in self.exclusions]
        stay = [] if self.outline == EVERYWHERE else [(True, self.outline)]
        return (*out[: self.drawn_after], *stay, *out[self.drawn_after :])


EVERYWHERE: Final = Circle(x_m=0.0, y_m=0.0, radius_m=100_000.0)
"""The outline of a fence that only keeps the robot out: the largest that a robot takes."""
Fence: TypeAlias = Outline | Zones


def zones_of(fence: Fence) -> Zones:
    """Return a fence with its exclusions, if it has any."""
    return fence if isinstance(fence, Zones) else Zones(outline=fence, exclusions=())


def fence_with(drawn: Sequence[tuple[bool, Outline]]) -> Fence:
    """Return the fence of outlines as they were drawn, True for one to stay inside.

    Without such a one the robot stays out of the exclusions; of more than one the first counts.
    """
    stay = [at for at, (is_inclusion, _) in enumerate(drawn) if is_inclusion]
    outline = drawn[stay[0]][1] if stay else EVERYWHERE
    exclusions = tuple(one for is_inclusion, one in drawn if not is_inclusion)
    if not exclusions:
        return outline
    return Zones(outline=outline, exclusions=exclusions, drawn_after=stay[0] if stay else 0)


def is_allowed(fence: Fence, place: "Point") -> bool:
    """Return whether a point lies inside a fence and in none of its exclusions."""
    zones = zones_of(fence)
    return _holds(zones.outline, place) and not any(_holds(one, place) for one in zones.exclusions)


def _holds(outline: Outline, place: "Point") -> bool:
    if isinstance(outline, Circle):
        return dist(place, (outline.x_m, outline.y_m)) <= outline.radius_m
    return inside(outline.corners, place)


@dataclass(frozen=True, kw_only=True)
class Home:
    """The place on Earth where x and y are 0; x points east, y north. Its altitude is only kept."""

    latitude_deg: Annotated[float, Meta(ge=-85.0, le=85.0)]
    longitude_deg: Annotated[float, Meta(ge=-180.0, le=180.0)]
    altitude_m: Annotated[float, Meta(ge=-1e5, le=1e5)] = 0.0


@dataclass(frozen=True, kw_only=True)
class Mission:
    """Contents of a mission file: at least one step, a fence and a home."""

    waypoints: tuple[Step, ...]
    fence: Fence | None = None
    home: Home | None = None

    def __str__(self) -> str:
        count = len(self.places)
        more = len(self.waypoints) - count
        others = f", {more} other item{'' if more == 1 else 's'}" if more else ""
        fence = "" if self.fence is None else f", fence: {self.fence}"
        return f"{count} waypoint{'' if count == 1 else 's'}{others}{fence}"

    @property
    def places(self) -> tuple[tuple[int, Waypoint], ...]:
        """The steps with a place, each with its number from 1."""
        steps = enumerate(self.waypoints, start=1)
        return tuple((at, one) for at, one in steps if isinstance(one, Waypoint))


Point = tuple[float, float]
CLOSEST_M = 0.001
MAX_CORNERS = 200
"""Limit, because each side is compared with each other one; robots accept fewer."""


def fault_of(corners: Sequence[Point]) -> str:
    """Return what is wrong with an outline, or an empty text."""
    if len(corners) < 3:
        return f"has {len(corners)} corners, a fence needs at least 3"
    if len(corners) > MAX_CORNERS:
        return f"has {len(corners)} corners, at most {MAX_CORNERS} are allowed"
    for index, (a, b) in enumerate(zip(corners, [*corners[1:], corners[0]], strict=True)):
        if abs(a[0] - b[0]) < CLOSEST_M and abs(a[1] - b[1]) < CLOSEST_M:
            return f"corner {index} and the next one are the same place"
    sides = [(corners[at], corners[(at + 1) % len(corners)]) for at in range(len(corners))]
    for (i, one), (j, other) in combinations(enumerate(sides), 2):
        neighbours = j - i in (1, len(sides) - 1)
        if not neighbours and _cross(*one, *other):
            return f"side {i} and side {j} cross"
    return "" if _area(corners) else "encloses nothing"


def _cross(a: Point, b: Point, c: Point, d: Point) -> bool:
    return _turn(a, b, c) != _turn(a, b, d) and _turn(c, d, a) != _turn(c, d, b)


def _turn(a: Point, b: Point, c: Point) -> int:
    """Return 1 when a, b, c turn left, -1 right, 0 when they are in line."""
    product = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
    return (product > 0) - (product < 0)


def _area(corners: Sequence[Point]) -> float:
    """Return twice the area."""
    shifted = [*corners[1:], corners[0]]
    return abs(sum(a[0] * b[1] - b[0] * a[1] for a, b in zip(corners, shifted, strict=True)))


def inside(corners: Sequence[Point], place: Point) -> bool:
    """Return whether a point lies in an outline; on a side, either result is possible."""
    x, y = place
    within = False
    for a, b in zip(corners, [*corners[1:], corners[0]], strict=True):
        if (a[1] > y) != (b[1] > y) and x < a[0] + (y - a[1]) * (b[0] - a[0]) / (b[1] - a[1]):
            within = not within
    return within


class Problem(NamedTuple):
    """A problem; `where` is the key or the number of the item."""

    where: str
    reason: str
    fix: str
    line: int | None = None


class MissionError(UserError):
    """A mission that cannot be used; the text has one line per problem."""

    def __init__(self, file: str, problems: Sequence[Problem]) -> None:
        self.problems = tuple(sorted(problems, key=lambda problem: problem.line or 0))
        super().__init__("\n".join(problem_line(file, problem) for problem in self.problems))


def problem_line(file: str, problem: Problem) -> str:
    """Format a problem as one line."""
    place = file if problem.line is None else f"{file}:{problem.line}"
    where = f"{problem.where}: " if problem.where else ""
    fix = f"; {problem.fix}" if problem.fix else ""
    return f"{place}: {where}{problem.reason}{fix}"


def line_of(lines: Mapping[Key, int], key: Key) -> int | None:
    """Return the line of a key, or of the nearest table around it."""
    while key and key not in lines:
        key = key[:-1]
    return lines.get(key)
