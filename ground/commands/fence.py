"""`fence`: a circle or polygon that the robot does not leave, and that all goals must lie in."""

import argparse
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, Final

from ground.client.connection import within
from ground.client.missions import TransferOutcome
from ground.client.outcomes import Refused, Success
from ground.commands.command import (
    Group,
    OperatorCommand,
    command,
    number,
    parsed,
    place,
    positive,
)
from ground.missions.files import ENDINGS, read_fence
from ground.missions.mission import (
    EVERYWHERE,
    FARTHEST_M,
    Circle,
    Fence,
    Outline,
    Polygon,
    fault_of,
    zones_of,
)
from ground.robot import Robot
from protocol.options import finite
from runtime.cli.verb import MORE
from runtime.errors import UserError

FENCE: Final = Group(
    MORE, 30, "fence circle 3 2 2.5", "keep the robot inside of a circle or polygon"
)


@dataclass(frozen=True, slots=True, kw_only=True)
class TypedCircle:
    """A circle as it is typed, in metres."""

    x: float = place("X", "metres", parse=finite)
    y: float = place("Y", "metres", parse=finite)
    radius: float = place("R", "metres", parse=positive)

    def circle(self) -> Circle:
        """Return the circle; UserError for one that is too large or too far away."""
        for name, value in (("x", self.x), ("y", self.y), ("radius", self.radius)):
            within(value, -FARTHEST_M, FARTHEST_M, name, "m")
        return Circle(x_m=self.x, y_m=self.y, radius_m=self.radius)


@command(FENCE, example="fence circle 3 2 2.5", moves=True)
class SetFence(OperatorCommand):
    """Stay within R metres of X Y.

    Or in a polygon; in metres, in the robot's own frame.
    """

    typed: ClassVar[Any] = TypedCircle
    fence: Fence

    @classmethod
    def parsed(cls, found: Any) -> OperatorCommand:
        """Return the command for a circle."""
        return cls(fence=parsed(TypedCircle, found).circle())

    @property
    def verb(self) -> str:
        """The verb, with the kind of the fence."""
        outline = zones_of(self.fence).outline
        return f"fence {'circle' if isinstance(outline, Circle) else 'polygon'}"

    @property
    def line(self) -> str:
        """The line that would be typed for it in the app."""
        outline = zones_of(self.fence).outline
        if isinstance(outline, Circle):
            numbers = [outline.x_m, outline.y_m, outline.radius_m]
        else:
            numbers = [value for corner in outline.corners for value in corner]
        return " ".join((self.verb, *map(number, numbers)))

    async def perform(self, robot: Robot) -> TransferOutcome | Refused:
        """Upload the fence and return the robot's verdict."""
        return await robot.fence.set(self.fence)


@command(FENCE, example="fence polygon 0 0 6 0 6 4 0 4", moves=True)
class SetFenceOfFile(OperatorCommand):
    """Stay inside these corners.

    Those of the fence of a mission file.
    """

    file: Path = place("FILE", "a mission file with a fence, or X Y X Y X Y ...", joined=list)

    @classmethod
    def parsed(cls, found: Any) -> OperatorCommand:
        """Return the command for a file; `SetFence` for numbers."""
        words: list[str] = found.file
        if len(words) == 1 and words[0].lower().endswith(ENDINGS):
            return cls(file=Path(words[0]))
        return SetFence(fence=outlined(words))

    def read(self) -> SetFence:
        """Read the file; MissionError names its faults."""
        return SetFence(fence=read_fence(self.file))

    async def perform(self, robot: Robot) -> TransferOutcome | Refused:
        """Read the file and upload the fence."""
        return await self.read().perform(robot)


@command(FENCE, example="fence off", moves=True)
class ClearFence(OperatorCommand):
    """Remove the fence."""

    async def perform(self, robot: Robot) -> TransferOutcome | Refused:
        """Delete the fence from the robot and return its verdict."""
        return await robot.fence.clear()


@dataclass(frozen=True, slots=True)
class FenceShown(Success):
    """The robot's fence, None if it has none."""

    fence: Fence | None

    @property
    def text(self) -> str:
        """The fence with all its corners, in words."""
        return "no fence" if self.fence is None else in_words(self.fence)

    def as_json(self, verb: str, robot: str) -> dict[str, object]:
        """Return the fence as a row: centre and radius, or corners, in metres."""
        row: dict[str, object] = {"verb": verb, "robot": robot, "ok": True, "fence": None}
        if self.fence is not None:
            zones = zones_of(self.fence)
            row["fence"] = outline_row(zones.outline)
            if zones.exclusions:
                row["exclusions"] = [outline_row(one) for one in zones.exclusions]
        return row


def outline_row(outline: Outline) -> dict[str, object]:
    """Return the centre and radius of a circle, or the corners of a polygon."""
    if isinstance(outline, Circle):
        return {"x_m": outline.x_m, "y_m": outline.y_m, "radius_m": outline.radius_m}
    return {"corners": [list(corner) for corner in outline.corners]}


@command(FENCE, example="fence show --json")
class ShowFence(OperatorCommand):
    """Show the robot's fence."""

    async def perform(self, robot: Robot) -> FenceShown | TransferOutcome:
        """Download the fence; a verdict if the robot does not send it."""
        found = await robot.fence.download()
        return found if isinstance(found, TransferOutcome) else FenceShown(found)


def in_words(fence: Fence) -> str:
    """Describe a fence with all its corners."""
    zones = zones_of(fence)
    shown = [] if zones.outline == EVERYWHERE else [outline_words(zones.outline)]
    return "\n".join(shown + [f"out of {outline_words(one)}" for one in zones.exclusions])


def outline_words(outline: Outline) -> str:
    """Describe an outline with all its corners."""
    if isinstance(outline, Circle):
        return str(outline)
    return f"{outline}: {' '.join(f'({x:g}, {y:g})' for x, y in outline.corners)}"


def outlined(words: list[str]) -> Polygon:
    """Parse X Y X Y ... as corners; UserError if they enclose no area."""
    try:
        numbers = [finite(word) for word in words]
    except argparse.ArgumentTypeError as error:
        raise UserError(f"{error}; a fence is X Y X Y X Y ..., or a mission file") from error
    if len(numbers) % 2:
        raise UserError(f"{len(numbers)} numbers are not pairs: give X Y for each corner")
    for value in numbers:
        within(value, -FARTHEST_M, FARTHEST_M, "corner", "m")
    polygon = Polygon(corners=tuple(zip(numbers[::2], numbers[1::2], strict=True)))
    if fault := fault_of(polygon.corners):
        raise UserError(f"not a fence: {fault}; give the corners in order around the area")
    return polygon
