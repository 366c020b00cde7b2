"""Words that only the app knows: values that concern the screen, or what is kept beside it."""

import argparse
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Final, NamedTuple, TypeAlias

from ground.missions.draft import (
    AddWaypoint,
    ClearDraft,
    Edit,
    ListDraft,
    LoadDraft,
    RemoveWaypoint,
    SaveDraft,
    waypoint_at,
)
from protocol.options import finite, whole

SCREENS: Final = ("drive", "plots", "params", "log", "links", "worlds", "faults", "replay")
MOST_WAYPOINTS: Final = 65_535


@dataclass(frozen=True, slots=True)
class ShowHelp:
    """What can be typed, or what one command takes."""

    word: str = ""


@dataclass(frozen=True, slots=True)
class Quit:
    """Leave the app."""


@dataclass(frozen=True, slots=True)
class ShowKeys:
    """The keys of this screen."""


@dataclass(frozen=True, slots=True)
class SetTheme:
    """Choose the colours; without a name, list the themes."""

    name: str | None = None


@dataclass(frozen=True, slots=True)
class SaveScreen:
    """Save the screen as a picture, an .svg."""

    file: Path | None = None


@dataclass(frozen=True, slots=True)
class GoToScreen:
    """Go to a screen."""

    name: str


@dataclass(frozen=True, slots=True)
class SwitchLayers:
    """Switch layers of the map on or off; without names, choose one."""

    names: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Zoom:
    """The map nearer (in), farther (out) or whole (fit)."""

    how: str


@dataclass(frozen=True, slots=True)
class FollowRobot:
    """Keep the robot in the middle of the map, or stop doing so."""


@dataclass(frozen=True, slots=True)
class FindText:
    """Search the log."""

    text: str


@dataclass(frozen=True, slots=True)
class SelectRobot:
    """Look at another robot."""

    robot: str


@dataclass(frozen=True, slots=True)
class TakeHand:
    """Drive by hand with the arrow keys."""


@dataclass(frozen=True, slots=True)
class RecordHere:
    """Begin a recording, or end it."""

    begin: bool


@dataclass(frozen=True, slots=True)
class OpenReplay:
    """Look at a log as if it were live."""

    file: Path


@dataclass(frozen=True, slots=True)
class ShowGhost:
    """Another navigator from here, as a ghost on the map."""

    navigator: str | None = None


@dataclass(frozen=True, slots=True)
class ExplainTurn:
    """Why the robot turned."""


AppCommand: TypeAlias = (
    ShowHelp
    | Quit
    | ShowKeys
    | SetTheme
    | SaveScreen
    | GoToScreen
    | SwitchLayers
    | Zoom
    | FollowRobot
    | FindText
    | SelectRobot
    | TakeHand
    | RecordHere
    | OpenReplay
    | ShowGhost
    | ExplainTurn
    | Edit
)


class AppWords:
    """The words of one of them; argparse fills those that were declared."""

    verb: str
    word: str
    name: str
    file: Path
    names: list[str]
    how: str
    text: list[str]
    robot: str
    action: str
    navigator: str | None
    x: float
    y: float
    heading: float | None
    hold: float
    item: int

    def __init__(self, verb: str) -> None:
        self.verb = verb

    @classmethod
    def declare(cls, parser: argparse.ArgumentParser) -> None:
        """Without arguments."""

    def command(self) -> AppCommand:
        """UserError names what is out of range."""
        raise NotImplementedError


class PlainWords(AppWords):
    def command(self) -> AppCommand:
        return PLAIN[self.verb]


class HelpWords(AppWords):
    @classmethod
    def declare(cls, parser: argparse.ArgumentParser) -> None:
        parser.add_argument("word", nargs="?", default="", metavar="VERB")

    def command(self) -> ShowHelp:
        return ShowHelp(self.word)


class ThemeWords(AppWords):
    @classmethod
    def declare(cls, parser: argparse.ArgumentParser) -> None:
        parser.add_argument("name", nargs="?", metavar="THEME", help="without it, all are listed")

    def command(self) -> SetTheme:
        return SetTheme(self.name)


class SnapWords(AppWords):
    @classmethod
    def declare(cls, parser: argparse.ArgumentParser) -> None:
        parser.add_argument("file", nargs="?", type=Path, metavar="FILE", help="an .svg")

    def command(self) -> SaveScreen:
        return SaveScreen(self.file)


class ScreenWords(AppWords):
    @classmethod
    def declare(cls, parser: argparse.ArgumentParser) -> None:
        parser.add_argument("name", type=str.lower, choices=SCREENS)

    def command(self) -> GoToScreen:
        return GoToScreen(self.name)


class LayerWords(AppWords):
    @classmethod
    def declare(cls, parser: argparse.ArgumentParser) -> None:
        parser.add_argument("names", nargs="*", metavar="LAYER", help="switch these on or off")

    def command(self) -> SwitchLayers:
        return SwitchLayers(tuple(self.names))


class ZoomWords(AppWords):
    @classmethod
    def declare(cls, parser: argparse.ArgumentParser) -> None:
        parser.add_argument("how", choices=("in", "out", "fit"))

    def command(self) -> Zoom:
        return Zoom(self.how)


class FindWords(AppWords):
    @classmethod
    def declare(cls, parser: argparse.ArgumentParser) -> None:
        parser.add_argument("text", nargs="+", metavar="TEXT")

    def command(self) -> FindText:
        return FindText(" ".join(self.text))


class SelectWords(AppWords):
    @classmethod
    def declare(cls, parser: argparse.ArgumentParser) -> None:
        parser.add_argument("robot", metavar="ROBOT", help="the name of the robot to look at")

    def command(self) -> SelectRobot:
        return SelectRobot(self.robot)


class RecordWords(AppWords):
    @classmethod
    def declare(cls, parser: argparse.ArgumentParser) -> None:
        parser.add_argument("action", choices=("start", "stop"))

    def command(self) -> RecordHere:
        return RecordHere(self.action == "start")


class ReplayWords(AppWords):
    @classmethod
    def declare(cls, parser: argparse.ArgumentParser) -> None:
        parser.add_argument("file", type=Path, metavar="FILE", help="a .tlog or .mcap")

    def command(self) -> OpenReplay:
        return OpenReplay(self.file)


class GhostWords(AppWords):
    @classmethod
    def declare(cls, parser: argparse.ArgumentParser) -> None:
        help = "that drives the ghost"
        parser.add_argument("navigator", nargs="?", metavar="NAVIGATOR", help=help)

    def command(self) -> ShowGhost:
        return ShowGhost(self.navigator)


class DraftWords(AppWords):
    @classmethod
    def declare(cls, parser: argparse.ArgumentParser) -> None:
        names = "add|remove|list|clear|load|save|upload"
        actions = parser.add_subparsers(dest="action", required=True, metavar=names)
        adding = actions.add_parser("add", help="one more at the end of the draft")
        adding.add_argument("x", type=finite, metavar="X", help="metres")
        adding.add_argument("y", type=finite, metavar="Y", help="metres")
        adding.add_argument("heading", type=finite, nargs="?", metavar="DEG")
        adding.add_argument("--hold", type=finite, default=0.0, metavar="S", help="wait there")
        removing = actions.add_parser("remove", help="take one out of the draft")
        removing.add_argument("item", type=whole(1, MOST_WAYPOINTS), metavar="ITEM")
        others = {"list": "the draft", "clear": "begin anew", "upload": "to the robot"}
        for name, says in others.items():
            actions.add_parser(name, help=says)
        for name in ("load", "save"):
            filing = actions.add_parser(name, help="a .toml, .plan or .waypoints")
            filing.add_argument("file", type=Path, metavar="FILE")

    def command(self) -> Edit:
        if self.action == "add":
            return AddWaypoint(waypoint_at(self.x, self.y, self.heading, self.hold))
        if self.action == "remove":
            return RemoveWaypoint(self.item)
        if self.action == "load":
            return LoadDraft(self.file)
        if self.action == "save":
            return SaveDraft(self.file)
        return ListDraft() if self.action == "list" else ClearDraft()


class Local(NamedTuple):
    """How its words are read, and what it does."""

    words: type[AppWords]
    says: str


PLAIN: Final[Mapping[str, AppCommand]] = MappingProxyType(
    {
        "quit": Quit(),
        "keys": ShowKeys(),
        "follow": FollowRobot(),
        "teleop": TakeHand(),
        "why": ExplainTurn(),
    }
)
LOCAL: Final[Mapping[str, Local]] = MappingProxyType(
    {
        "help": Local(HelpWords, "what can be typed here, or what a verb takes"),
        "quit": Local(PlainWords, "leave; the robot is told if it depends on us"),
        "keys": Local(PlainWords, "the keys of this screen"),
        "theme": Local(ThemeWords, "choose the colours"),
        "snap": Local(SnapWords, "save the screen as a picture"),
        "screen": Local(ScreenWords, "go to a screen"),
        "layers": Local(LayerWords, "what the map shows"),
        "zoom": Local(ZoomWords, "the map nearer, farther or whole"),
        "follow": Local(PlainWords, "keep the robot in the middle of the map, or stop doing so"),
        "find": Local(FindWords, "search the log"),
        "select": Local(SelectWords, "look at another robot"),
        "teleop": Local(PlainWords, "drive by hand with the arrow keys"),
        "wp": Local(DraftWords, "draft a mission"),
        "record": Local(RecordWords, "begin a recording, or end it"),
        "replay": Local(ReplayWords, "look at a log as if it were live"),
        "ghost": Local(GhostWords, "another navigator from here, as a ghost on the map"),
        "why": Local(PlainWords, "why the robot turned"),
    }
)
