"""Arguments of `fence`."""

import argparse
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

from ground.client.connection import within
from ground.client.missions import TransferOutcome
from ground.client.outcomes import Outcome, Refused
from ground.client.session import Operation
from ground.commands.command import add_common, add_seize, positive
from ground.commands.fence import ClearFence, SetFence, ShowFence
from ground.grammar.words import Words
from ground.missions.files import ENDINGS, read_fence
from ground.missions.mission import FARTHEST_M, Circle, Polygon, fault_of
from ground.robot import Robot
from protocol.options import finite
from runtime.cli.parsers import add_subcommands
from runtime.errors import UserError


@dataclass(frozen=True, slots=True, kw_only=True)
class SetFenceOfFile:
    """The same as SetFence with the fence of a mission file."""

    verb: ClassVar[str] = "fence polygon"
    moves: ClassVar[bool] = True
    file: Path

    def read(self) -> SetFence:
        """Read the file; MissionError names its faults."""
        return SetFence(fence=read_fence(self.file))

    async def perform(self, robot: Robot) -> TransferOutcome | Refused:
        """Read the file and upload the fence."""
        return await self.read().perform(robot)


class FenceWords(Words):
    """The arguments of `fence`."""

    x: float
    y: float
    radius: float
    corners: list[str]

    @classmethod
    def declare(cls, parser: argparse.ArgumentParser) -> None:
        """Declare the arguments."""
        actions = add_subcommands(parser, "fence")
        circling = actions["circle"]
        circling.add_argument("x", type=finite, metavar="X", help="metres")
        circling.add_argument("y", type=finite, metavar="Y", help="metres")
        circling.add_argument("radius", type=positive, metavar="R", help="metres")
        help = "a mission file with a fence, or X Y X Y X Y ..."
        actions["polygon"].add_argument("corners", nargs="+", metavar="FILE", help=help)
        for action in actions.values():
            add_common(action)
        for name in ("circle", "polygon", "off"):
            add_seize(actions[name])

    def operation(self) -> Operation[Outcome]:
        """Return the operation for the parsed arguments."""
        if self.action == "show":
            return ShowFence()
        if self.action == "off":
            return ClearFence()
        if self.action == "circle":
            return SetFence(fence=self._circle())
        first = self.corners[0]
        if len(self.corners) == 1 and first.lower().endswith(ENDINGS):
            return SetFenceOfFile(file=Path(first))
        return SetFence(fence=outlined(self.corners))

    def _circle(self) -> Circle:
        for name, value in (("x", self.x), ("y", self.y), ("radius", self.radius)):
            within(value, -FARTHEST_M, FARTHEST_M, name, "m")
        return Circle(x_m=self.x, y_m=self.y, radius_m=self.radius)


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
