"""Arguments of `goto` and `teleop`."""

import argparse

from ground.client.floor import EXAMPLE
from ground.client.goal import (
    FRAMES,
    HEADING_TOLERANCE_DEG,
    POSITION_TOLERANCE_M,
    Destination,
    destination,
)
from ground.commands.command import add_anyway, add_common, add_seize, positive, seconds
from ground.commands.goto import Goto
from ground.commands.teleop import DriveByHand
from ground.grammar.words import Words
from protocol.options import finite
from runtime.errors import UserError


class GotoWords(Words):
    """The arguments of `goto`."""

    x: float | None
    y: float | None
    heading: float | None
    tolerance: float
    heading_tolerance: float
    frame: str
    no_wait: bool
    timeout: float | None
    anyway: bool

    @classmethod
    def declare(cls, parser: argparse.ArgumentParser) -> None:
        """Declare the arguments."""
        help = "metres; without X Y the goal of the simulated world"
        parser.add_argument("x", nargs="?", type=finite, metavar="X", help=help)
        parser.add_argument("y", nargs="?", type=finite, metavar="Y", help="metres")
        help = "degrees: final heading; without it any"
        parser.add_argument("heading", type=finite, nargs="?", metavar="DEG", help=help)
        declare_tolerances(parser)
        parser.add_argument(
            "--frame",
            choices=FRAMES,
            default="world",
            help="body: X ahead of the robot, Y to its left, DEG from its heading (default world)",
        )
        add_common(parser)
        add_seize(parser)
        parser.add_argument(
            "--no-wait",
            action="store_true",
            help="drive in AUTO, which needs no operator; do not wait",
        )
        parser.add_argument("--timeout", type=seconds, metavar="S", help="abort after this time")
        add_anyway(parser, "a goal")

    def operation(self) -> Goto:
        """Return the operation for the parsed arguments."""
        seen_by_robot, wait = self.frame == "body", not self.no_wait
        return Goto(
            goal=self.goal(),
            seen_by_robot=seen_by_robot,
            wait=wait,
            timeout_s=self.timeout,
            anyway=self.anyway,
        )

    def goal(self) -> Destination | None:
        """Return the goal, or None without X Y; UserError if only a part of it is given."""
        if self.x is not None and self.y is not None:
            return destination(
                [self.x, self.y] + ([] if self.heading is None else [self.heading]),
                position_tolerance_m=self.tolerance,
                heading_tolerance_deg=self.heading_tolerance,
            )
        if self.x is not None:
            raise UserError(f"Y is missing; {EXAMPLE}")
        usual = (POSITION_TOLERANCE_M, HEADING_TOLERANCE_DEG, "world")
        if (self.tolerance, self.heading_tolerance, self.frame) != usual:
            raise UserError(f"a tolerance and --frame body need X Y; {EXAMPLE}")
        return None


def declare_tolerances(parser: argparse.ArgumentParser) -> None:
    """Declare the tolerances of a goal."""
    parser.add_argument(
        "--tolerance",
        "--tol",
        "--position-tolerance",
        type=positive,
        default=POSITION_TOLERANCE_M,
        metavar="M",
        help=f"arrived within this distance (default {POSITION_TOLERANCE_M:g})",
    )
    parser.add_argument(
        "--heading-tolerance",
        type=positive,
        default=HEADING_TOLERANCE_DEG,
        metavar="DEG",
        help=f"aligned within this angle (default {HEADING_TOLERANCE_DEG:g})",
    )


class TeleopWords(Words):
    """The arguments of `teleop`."""

    speed: float
    turn: float
    last: float | None

    @classmethod
    def declare(cls, parser: argparse.ArgumentParser) -> None:
        """Declare the arguments."""
        parser.add_argument("speed", type=finite, metavar="SPEED", help="m/s, negative: backwards")
        parser.add_argument("turn", type=finite, metavar="YAW_DEG_S", help="deg/s, positive: left")
        parser.add_argument(
            "--for", dest="last", type=seconds, metavar="S", help="stop after this time"
        )
        add_common(parser)
        add_seize(parser)

    def operation(self) -> DriveByHand:
        """Return the operation for the parsed arguments."""
        return DriveByHand(speed_m_s=self.speed, turn_deg_s=self.turn, for_s=self.last)
