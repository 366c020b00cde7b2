"""Words that only the app knows, as they concern the screen or what is kept beside it.

They are read here as all others are; the app does them.
"""

import argparse
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Final, NamedTuple

from ground.cli.verbs import Arguments
from protocol.options import finite, whole

SCREENS: Final = ("drive", "plots", "params", "log", "links", "worlds", "faults", "replay")
MOST_WAYPOINTS: Final = 65_535


class Local(NamedTuple):
    """How to read its arguments, and what it does."""

    arguments: Arguments
    says: str


def nothing(_: argparse.ArgumentParser) -> None:
    """No arguments."""


def _help(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("word", nargs="?", default="", metavar="VERB")


def _theme(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("name", nargs="?", metavar="THEME", help="without it, all are listed")


def _snap(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("file", nargs="?", type=Path, metavar="FILE", help="an .svg")


def _screen(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("name", type=str.lower, choices=SCREENS)


def _replay(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("file", type=Path, metavar="FILE", help="a .tlog or .mcap")


def _find(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("text", nargs="+", metavar="TEXT")


def _select(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("robot", metavar="ROBOT", help="the name of the robot to look at")


def _layers(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("names", nargs="*", metavar="LAYER", help="switch these on or off")


def _zoom(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("how", choices=("in", "out", "fit"))


def _record(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("action", choices=("start", "stop"))


def _ghost(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("navigator", nargs="?", metavar="NAVIGATOR", help="that drives the ghost")


def _waypoints(parser: argparse.ArgumentParser) -> None:
    names = "add|remove|list|clear|load|save|upload"
    actions = parser.add_subparsers(dest="action", required=True, metavar=names)
    adding = actions.add_parser("add", help="one more at the end of the draft")
    adding.add_argument("x", type=finite, metavar="X", help="metres")
    adding.add_argument("y", type=finite, metavar="Y", help="metres")
    adding.add_argument("heading", type=finite, nargs="?", metavar="DEG")
    adding.add_argument("--hold", type=finite, default=0.0, metavar="S", help="wait there")
    removing = actions.add_parser("remove", help="take one out of the draft")
    removing.add_argument("item", type=whole(1, MOST_WAYPOINTS), metavar="ITEM")
    for name, says in (("list", "the draft"), ("clear", "begin anew"), ("upload", "to the robot")):
        actions.add_parser(name, help=says)
    for name in ("load", "save"):
        filing = actions.add_parser(name, help="a .toml, .plan or .waypoints")
        filing.add_argument("file", type=Path, metavar="FILE")


LOCAL: Final[Mapping[str, Local]] = MappingProxyType(
    {
        "help": Local(_help, "what can be typed here, or what a verb takes"),
        "quit": Local(nothing, "leave; the robot is told if it depends on us"),
        "keys": Local(nothing, "the keys of this screen"),
        "theme": Local(_theme, "choose the colours"),
        "snap": Local(_snap, "save the screen as a picture"),
        "screen": Local(_screen, "go to a screen"),
        "layers": Local(_layers, "what the map shows"),
        "zoom": Local(_zoom, "the map nearer, farther or whole"),
        "follow": Local(nothing, "keep the robot in the middle of the map, or stop doing so"),
        "find": Local(_find, "search the log"),
        "select": Local(_select, "look at another robot"),
        "teleop": Local(nothing, "drive by hand with the arrow keys"),
        "wp": Local(_waypoints, "draft a mission"),
        "record": Local(_record, "begin a recording, or end it"),
        "replay": Local(_replay, "look at a log as if it were live"),
        "ghost": Local(_ghost, "another navigator from here, as a ghost on the map"),
        "why": Local(nothing, "why the robot turned"),
    }
)
