"""Commands that only the app has: those of the screen and of its recordings and drafts.

Each is a class as in `ground/commands/`, without a robot: the app carries it out.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any, ClassVar, Final, Self

from ground.client.vocabulary import NAVIGATOR_SUMMARIES
from ground.commands.command import (
    Group,
    OperatorCommand,
    choice,
    command,
    option,
    parsed,
    place,
    rows_in,
    typed_words,
)
from ground.commands.mission import DRAFT, item_number
from ground.map.scene import LAYERS
from ground.missions.files import Draft, waypoint_at
from ground.missions.mission import Waypoint
from ground.text.wording import THEMES
from protocol.options import finite
from runtime.cli.verb import APP, Verb

SCREENS: Final = ("drive", "plots", "params", "log", "links", "worlds", "faults", "replay")


class AppCommand(OperatorCommand):
    """A command that the app carries out itself."""

    __slots__ = ()
    shared = ()


class KeyCommand(AppCommand):
    """A command that does what the key with the id `key` does."""

    __slots__ = ()
    key: Any
    """A string; a property of a class whose key follows from its value."""


@command(APP, example="help goto", also=("?",))
class ShowHelp(AppCommand):
    """Show all commands, or the arguments of one."""

    word: str = place("VERB", default="")


@command(APP, example="quit", also=("q", "exit"))
class Quit(KeyCommand):
    """Leave the app; gives the lease back, unless another program of yours is there."""

    key = "quit"


@command(APP, example="suspend")
class Suspend(KeyCommand):
    """Go back to the shell; fg continues."""

    key = "suspend"


@command(APP, example="mouse off")
class SwitchMouse(AppCommand):
    """Leave the mouse to the terminal, which selects and copies any text, or take it back."""

    action: str = choice(("on", "off"), parse=str)


@command(APP, example="keys")
class ShowKeys(KeyCommand):
    """Show the keys of this screen."""

    key = "help"


@command(APP, example="theme light")
class SetTheme(AppCommand):
    """Choose the colours."""

    name: str | None = place(
        "THEME",
        "without it, list the themes",
        default=None,
        meanings=dict.fromkeys(THEMES, ""),
    )


@command(APP, example="snap screen.svg")
class SaveScreen(AppCommand):
    """Save the screen as a picture."""

    file: Path | None = place("FILE", "an .svg", default=None, parse=Path)


@command(APP, example="screen plots")
class GoToScreen(AppCommand):
    """Go to a screen."""

    name: str = choice(SCREENS)


@command(APP, example="layers trail truth")
class SwitchLayers(AppCommand):
    """Choose the layers of the map."""

    names: tuple[str, ...] = place(
        "LAYER",
        "switch these on or off",
        default=(),
        joined=tuple,
        spelt=" ".join,
        meanings=dict.fromkeys(LAYERS, ""),
    )


@command(APP, example="zoom in")
class Zoom(KeyCommand):
    """Zoom the map in, out, or to the whole world."""

    how: str = choice({"in": "zoom-in", "out": "zoom-out", "fit": "fit"}, parse=str)

    @property
    def key(self) -> str:
        """The id of its key."""
        return self.how


@command(APP, example="follow")
class FollowRobot(KeyCommand):
    """Centre the map on the robot, or stop it."""

    key = "follow"


@command(APP, example="find refused")
class FindText(AppCommand):
    """Search the log."""

    text: str = place("TEXT", joined=" ".join)


@command(APP, example="select r2")
class SelectRobot(AppCommand):
    """Show another robot."""

    robot: str = place("ROBOT", "name of the robot")


@command(APP, example="teleop")
class BeginTeleop(KeyCommand):
    """Drive by hand with the arrow keys."""

    key = "teleop"


WP: Final = Group(APP, 0, "wp add 5.4 2 90", "draft a mission")


class DraftCommand(AppCommand):
    """A command on the draft of a mission."""

    __slots__ = ()

    def edit(self, draft: Draft) -> str:
        """Do it and return what was done, in words; UserError on failure."""
        raise NotImplementedError


@dataclass(frozen=True, slots=True, kw_only=True)
class TypedWaypoint:
    """A waypoint as it is typed, in metres and degrees."""

    x: float = place("X", "metres", parse=finite)
    y: float = place("Y", "metres", parse=finite)
    heading: float | None = place("DEG", "degrees", default=None, parse=finite)
    hold: float = option("--hold", default=0.0, parse=finite, metavar="S", help="wait there")


@command(WP, example="wp add 5.4 2 90")
class AddWaypoint(DraftCommand):
    """Append a waypoint to the draft."""

    typed: ClassVar[Any] = TypedWaypoint
    waypoint: Waypoint

    @classmethod
    def parsed(cls, found: Any) -> Self:
        """Return the command for parsed arguments; UserError for a value out of range."""
        typed = parsed(TypedWaypoint, found)
        return cls(waypoint=waypoint_at(typed.x, typed.y, typed.heading, typed.hold))

    @property
    def line(self) -> str:
        """The line that would be typed for it."""
        at = self.waypoint
        typed = TypedWaypoint(x=at.x_m, y=at.y_m, heading=at.heading_deg, hold=at.hold_s)
        return " ".join((self.facts.word, *typed_words(typed)))

    def edit(self, draft: Draft) -> str:
        """Append it."""
        return draft.add(self.waypoint)


@command(WP, example="wp remove 2")
class RemoveWaypoint(DraftCommand):
    """Remove a waypoint from the draft."""

    item: int = place("ITEM", parse=item_number)

    def edit(self, draft: Draft) -> str:
        """Remove it; `item` counts from 1."""
        return draft.remove(self.item)


@command(WP, example="wp list")
class ListDraft(DraftCommand):
    """Show the draft."""

    def edit(self, draft: Draft) -> str:
        """Return its lines."""
        return draft.listed()


@command(WP, example="wp clear")
class ClearDraft(DraftCommand):
    """Empty the draft."""

    def edit(self, draft: Draft) -> str:
        """Empty it."""
        return draft.clear()


@command(WP, example=DRAFT)
class SendDraft(AppCommand):
    """Send to the robot.

    It is here for the help and the completion: its line is read as `mission upload -`.
    """


@command(WP, example="wp load mission.toml")
class LoadDraft(DraftCommand):
    """A .toml, .plan or .waypoints file."""

    file: Path = place("FILE", parse=Path)

    def edit(self, draft: Draft) -> str:
        """Make the mission of the file the draft."""
        return draft.load(self.file)


@command(WP, example="wp save mission.toml")
class SaveDraft(DraftCommand):
    """A .toml, .plan or .waypoints file."""

    file: Path = place("FILE", parse=Path)

    def edit(self, draft: Draft) -> str:
        """Write the draft to the file."""
        return draft.save(self.file)


@command(APP, example="record start", also={"rec start": ("start",), "rec stop": ("stop",)})
class RecordHere(AppCommand):
    """Start or stop a recording."""

    action: str = choice(("start", "stop"), parse=str)


@command(APP, example="replay drive.mcap")
class OpenReplay(AppCommand):
    """Show a log as if it were live."""

    file: str | None = place("FILE", "a .tlog or .mcap (default the newest)", default=None)


@command(APP, example="undo")
class Undo(AppCommand):
    """Take back the last goal, or change of a parameter, the fence or the draft."""


@command(APP, example="copy pose")
class CopyText(AppCommand):
    """Copy the pose, the last command or the chosen row."""

    what: str = choice(("pose", "last", "row"), parse=str)


@command(APP, example="ghost bug")
class ShowGhost(AppCommand):
    """Show another navigator from here, as a ghost on the map."""

    navigator: str | None = place(
        "NAVIGATOR", "navigator of the ghost", default=None, meanings=NAVIGATOR_SUMMARIES
    )


@command(APP, example="why")
class ExplainTurn(KeyCommand):
    """Explain why the robot turned."""

    key = "explain"


LOCAL: Final[Mapping[str, Verb]] = MappingProxyType(rows_in(globals()))
