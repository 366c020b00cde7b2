"""Arguments of `pose`."""

import argparse

from ground.client.outcomes import Outcome
from ground.client.session import Operation
from ground.commands.command import add_anyway, add_common, add_seize, seconds
from ground.commands.pose import SetPose, SetTruePose
from ground.grammar.words import Words
from protocol.options import finite
from runtime.cli.parsers import add_subcommands


class PoseWords(Words):
    """The arguments of `pose`."""

    x: float
    y: float
    heading: float | None
    timeout: float | None
    anyway: bool

    @classmethod
    def declare(cls, parser: argparse.ArgumentParser) -> None:
        """Declare the arguments."""
        actions = add_subcommands(parser, "pose")
        setting = actions["set"]
        setting.add_argument("x", type=finite, metavar="X", help="metres")
        setting.add_argument("y", type=finite, metavar="Y", help="metres")
        help = "heading; without it the robot keeps its own, if it knows its place"
        setting.add_argument("heading", type=finite, nargs="?", metavar="DEG", help=help)
        add_anyway(setting, "a pose")
        for action in actions.values():
            add_common(action)
            add_seize(action)
            help = "give up after this time, in three attempts (default 1.5)"
            action.add_argument("--timeout", type=seconds, metavar="S", help=help)

    def operation(self) -> Operation[Outcome]:
        """Return the operation for the parsed arguments."""
        if self.action == "truth":
            return SetTruePose(timeout_s=self.timeout)
        return SetPose(
            x_m=self.x,
            y_m=self.y,
            heading_deg=self.heading,
            anyway=self.anyway,
            timeout_s=self.timeout,
        )
