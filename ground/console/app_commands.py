"""Commands that only the app has: those of the screen and of its recordings and drafts."""

import argparse
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Final, NamedTuple, TypeAlias

from ground.missions.files import (
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
COPIED: Final = ("pose", "last", "row")
MAX_WAYPOINTS: Final = 65_535
ZOOM_KEYS: Final = {"in": "zoom-in", "out": "zoom-out", "fit": "fit"}


@dataclass(frozen=True, slots=True)
class ShowHelp:
    """Show all commands, or the arguments of one."""

    word: str = ""


@dataclass(frozen=True, slots=True)
class RunKey:
    """Do what the key with this id does."""

    id: str


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
    """Switch layers of the map on or off; without names, open the choice."""

    names: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class FindText:
    """Search the log."""

    text: str


@dataclass(frozen=True, slots=True)
class SelectRobot:
    """Show another robot."""

    robot: str


@dataclass(frozen=True, slots=True)
class RecordHere:
    """Start or stop a recording."""

    begin: bool


@dataclass(frozen=True, slots=True)
class OpenReplay:
    """Show a recording; `file` as for `recording_named`."""

    file: str | None


@dataclass(frozen=True, slots=True)
class Undo:
    """Take back the last change of a parameter, the fence or the mission draft."""


@dataclass(frozen=True, slots=True)
class CopyText:
    """Copy the pose of the robot, the last command, or the chosen row to the clipboard."""

    what: str


@dataclass(frozen=True, slots=True)
class ShowGhost:
    """Show another navigator from here, as a ghost on the map."""

    navigator: str | None = None


AppCommand: TypeAlias = (
    ShowHelp
    | RunKey
    | SetTheme
    | SaveScreen
    | GoToScreen
    | SwitchLayers
    | FindText
    | SelectRobot
    | RecordHere
    | OpenReplay
    | ShowGhost
    | Undo
    | CopyText
    | Edit
)


class AppArguments:
    """The parsed arguments of a command; argparse sets those that the command declares."""

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
    what: str


def _declare_theme(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("name", nargs="?", metavar="THEME", help="without it, list the themes")


def _declare_layers(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("names", nargs="*", metavar="LAYER", help="switch these on or off")


def _declare_ghost(parser: argparse.ArgumentParser) -> None:
    text = "navigator of the ghost"
    parser.add_argument("navigator", nargs="?", metavar="NAVIGATOR", help=text)


def _declare_draft(parser: argparse.ArgumentParser) -> None:
    names = "add|remove|list|clear|load|save|upload"
    actions = parser.add_subparsers(dest="action", required=True, metavar=names)
    adding = actions.add_parser("add", help="append a waypoint to the draft")
    adding.add_argument("x", type=finite, metavar="X", help="metres")
    adding.add_argument("y", type=finite, metavar="Y", help="metres")
    adding.add_argument("heading", type=finite, nargs="?", metavar="DEG", help="degrees")
    adding.add_argument("--hold", type=finite, default=0.0, metavar="S", help="wait there")
    removing = actions.add_parser("remove", help="remove a waypoint from the draft")
    removing.add_argument("item", type=whole(1, MAX_WAYPOINTS), metavar="ITEM")
    others = {"list": "show the draft", "clear": "empty the draft", "upload": "send to the robot"}
    for name, text in others.items():
        actions.add_parser(name, help=text)
    for name in ("load", "save"):
        filing = actions.add_parser(name, help="a .toml, .plan or .waypoints file")
        filing.add_argument("file", type=Path, metavar="FILE")


def _draft_edit(arguments: AppArguments) -> Edit:
    match arguments.action:
        case "add":
            x_m, y_m, heading_deg = arguments.x, arguments.y, arguments.heading
            return AddWaypoint(waypoint_at(x_m, y_m, heading_deg, arguments.hold))
        case "remove":
            return RemoveWaypoint(arguments.item)
        case "load":
            return LoadDraft(arguments.file)
        case "save":
            return SaveDraft(arguments.file)
        case "list":
            return ListDraft()
    return ClearDraft()


def _no_arguments(_: argparse.ArgumentParser) -> None:
    """Declare nothing."""


class LocalVerb(NamedTuple):
    """A verb of the app: its summary, its command, and the declaration of its arguments.

    `command` raises UserError for an argument out of range.
    """

    summary: str
    command: Callable[[AppArguments], AppCommand]
    declare: Callable[[argparse.ArgumentParser], object] = _no_arguments


LOCAL: Final[Mapping[str, LocalVerb]] = MappingProxyType(
    {
        "help": LocalVerb(
            "show all commands, or the arguments of one",
            lambda arguments: ShowHelp(arguments.word),
            lambda parser: parser.add_argument("word", nargs="?", default="", metavar="VERB"),
        ),
        "quit": LocalVerb(
            "leave the app; gives the lease back, unless another program of yours is there",
            lambda _: RunKey("quit"),
        ),
        "keys": LocalVerb("show the keys of this screen", lambda _: RunKey("help")),
        "theme": LocalVerb(
            "choose the colours", lambda arguments: SetTheme(arguments.name), _declare_theme
        ),
        "snap": LocalVerb(
            "save the screen as a picture",
            lambda arguments: SaveScreen(arguments.file),
            lambda parser: parser.add_argument(
                "file", nargs="?", type=Path, metavar="FILE", help="an .svg"
            ),
        ),
        "screen": LocalVerb(
            "go to a screen",
            lambda arguments: GoToScreen(arguments.name),
            lambda parser: parser.add_argument("name", type=str.lower, choices=SCREENS),
        ),
        "layers": LocalVerb(
            "choose the layers of the map",
            lambda arguments: SwitchLayers(tuple(arguments.names)),
            _declare_layers,
        ),
        "zoom": LocalVerb(
            "zoom the map in, out, or to the whole world",
            lambda arguments: RunKey(ZOOM_KEYS[arguments.how]),
            lambda parser: parser.add_argument("how", choices=tuple(ZOOM_KEYS)),
        ),
        "follow": LocalVerb("centre the map on the robot, or stop it", lambda _: RunKey("follow")),
        "find": LocalVerb(
            "search the log",
            lambda arguments: FindText(" ".join(arguments.text)),
            lambda parser: parser.add_argument("text", nargs="+", metavar="TEXT"),
        ),
        "select": LocalVerb(
            "show another robot",
            lambda arguments: SelectRobot(arguments.robot),
            lambda parser: parser.add_argument("robot", metavar="ROBOT", help="name of the robot"),
        ),
        "teleop": LocalVerb("drive by hand with the arrow keys", lambda _: RunKey("teleop")),
        "wp": LocalVerb("draft a mission", _draft_edit, _declare_draft),
        "record": LocalVerb(
            "start or stop a recording",
            lambda arguments: RecordHere(arguments.action == "start"),
            lambda parser: parser.add_argument("action", choices=("start", "stop")),
        ),
        "replay": LocalVerb(
            "show a log as if it were live",
            lambda arguments: OpenReplay(None if arguments.file is None else str(arguments.file)),
            lambda parser: parser.add_argument(
                "file", nargs="?", metavar="FILE", help="a .tlog or .mcap (default the newest)"
            ),
        ),
        "undo": LocalVerb(
            "take back the last change of a parameter, the fence or the draft", lambda _: Undo()
        ),
        "copy": LocalVerb(
            "copy the pose, the last command or the chosen row",
            lambda arguments: CopyText(arguments.what),
            lambda parser: parser.add_argument("what", choices=COPIED),
        ),
        "ghost": LocalVerb(
            "show another navigator from here, as a ghost on the map",
            lambda arguments: ShowGhost(arguments.navigator),
            _declare_ghost,
        ),
        "why": LocalVerb("explain why the robot turned", lambda _: RunKey("explain")),
    }
)
