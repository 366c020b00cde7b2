"""Arguments of `mission`, and its operations on files."""

import argparse
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, Final

from ground.client.missions import TransferOutcome
from ground.client.outcomes import Progress, Refused, Success
from ground.commands.abort import Abort
from ground.commands.command import add_anyway, add_common, add_json, add_seize
from ground.commands.hold import Hold
from ground.commands.mission import (
    ClearMission,
    DownloadMission,
    FetchMission,
    JumpTo,
    ShowMissionStatus,
    StartMission,
    UploadMission,
)
from ground.commands.resume import Resume
from ground.grammar.words import Words
from ground.missions import files
from ground.missions.mission import Home
from ground.missions.qgroundcontrol import Foreign, home_at
from ground.robot import Robot
from protocol.options import finite, whole
from runtime.cli.parsers import add_subcommands
from runtime.errors import UserError

MOST_ITEMS: Final = 65_535
"""Limit of an item's number; people count from 1, the wire from 0."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MissionFile:
    """A mission file to read; `-` is standard input, or the text returned by `typed`.

    `drop`: leave out items that the robot cannot carry out.
    """

    file: Path
    home: Home | None = None
    drop: bool = False
    typed: Callable[[], str] | None = None

    def read(self) -> Foreign:
        """Read the mission; MissionError names all faults of the file."""
        if self.file != files.DASH:
            return files.read(self.file, home=self.home, drop=self.drop)
        text = sys.stdin.read(files.LARGEST_BYTES) if self.typed is None else self.typed()
        return files.read_text(text, self.file, home=self.home, drop=self.drop)


@dataclass(frozen=True, slots=True, kw_only=True)
class UploadMissionFile:
    """The same as UploadMission with the mission of a file."""

    verb: ClassVar[str] = "mission upload"
    moves: ClassVar[bool] = True
    source: MissionFile
    anyway: bool = False

    def read(self) -> UploadMission:
        """Read the file."""
        found = self.source.read()
        return UploadMission(mission=found.mission, dropped=found.dropped, anyway=self.anyway)

    async def perform(self, robot: Robot) -> TransferOutcome | Refused:
        """Read the file and upload the mission."""
        return await self.read().perform(robot)


@dataclass(frozen=True, slots=True)
class MissionChecked(Success):
    """A valid mission file; written as `out`, without the items in `lost`."""

    found: Foreign
    out: Path | None = None
    lost: tuple[str, ...] = ()

    @property
    def text(self) -> str:
        """The mission, or the file that was written."""
        mission = self.found.mission
        return f"ok, {mission}" if self.out is None else files.written(self.out, mission, self.lost)

    def as_json(self, verb: str, robot: str) -> dict[str, object]:
        """Return counts and losses as a row."""
        row: dict[str, object] = {
            "verb": verb,
            "ok": True,
            "items": len(self.found.mission.waypoints),
            "dropped": list(self.found.dropped),
        }
        if self.out is None:
            return row
        return row | {"file": str(self.out), "lost": list(self.lost)}


@dataclass(frozen=True, slots=True, kw_only=True)
class CheckMission:
    """Read a mission file; with `out`, write it in the format of that suffix."""

    moves: ClassVar[bool] = False
    is_offline: ClassVar[bool] = True
    source: MissionFile
    out: Path | None = None

    @property
    def verb(self) -> str:
        """The verb, by whether a file is written."""
        return "mission check" if self.out is None else "mission convert"

    def run(self, progress: Progress) -> MissionChecked:
        """Check the file without a robot."""
        found, lost = self.source.read(), tuple[str, ...]()
        if self.out is not None:
            if self.out.resolve() == self.source.file.resolve():
                raise UserError(f"{self.out} is also the input: give another name")
            lost = files.write(self.out, found.mission)
        for what in found.dropped:
            progress.note(f"left out: {what}")
        return MissionChecked(found, self.out, lost)


class MissionWords(Words):
    """The arguments of `mission`."""

    file: Path
    out: Path
    item: int | None
    home: tuple[float, float] | None
    drop: bool
    anyway: bool
    typed: Callable[[], str] | None = None
    """Returns the text for the file `-`; without it, standard input is read."""

    @classmethod
    def declare(cls, parser: argparse.ArgumentParser) -> None:
        """Declare the arguments."""
        actions = add_subcommands(parser, "mission")
        endings = ".toml, .plan or .waypoints"
        for name in ("check", "upload", "download"):
            actions[name].add_argument("file", type=Path, metavar="FILE", help=endings)
        actions["convert"].add_argument("file", type=Path, metavar="IN")
        actions["convert"].add_argument("out", type=Path, metavar="OUT")
        item, help = whole(1, MOST_ITEMS), "from 1; without it the current one, or the first"
        help += " of a mission that is done"
        actions["start"].add_argument("item", nargs="?", type=item, metavar="ITEM", help=help)
        actions["jump"].add_argument("item", type=item, metavar="ITEM", help="from 1")
        for name in ("check", "convert", "upload", "download"):
            add_reading(actions[name])
        add_anyway(actions["upload"], "waypoints")
        for name, action in actions.items():
            if name in ("check", "convert"):
                add_json(action)
            else:
                add_common(action)
        for name in ("upload", "start", "resume", "jump", "clear"):
            add_seize(actions[name])

    def operation(self) -> Any:
        """Return the operation for the parsed arguments."""
        meanings: dict[str, Callable[[], Any]] = {
            "check": lambda: CheckMission(source=self._source()),
            "convert": lambda: CheckMission(source=self._source(), out=self.out),
            "upload": lambda: UploadMissionFile(source=self._source(), anyway=self.anyway),
            "download": lambda: DownloadMission(file=self.file, home=self._home()),
            "list": FetchMission,
            "start": lambda: StartMission(item=self.item),
            "pause": Hold,
            "resume": Resume,
            "abort": Abort,
            "jump": lambda: JumpTo(item=self.item or 1),
            "status": ShowMissionStatus,
            "clear": ClearMission,
        }
        return meanings[self.action]()

    def _source(self) -> MissionFile:
        return MissionFile(file=self.file, home=self._home(), drop=self.drop, typed=self.typed)

    def _home(self) -> Home | None:
        return None if self.home is None else home_at(*self.home)


def add_reading(parser: argparse.ArgumentParser) -> None:
    """Declare the options for reading mission files."""
    parser.add_argument(
        "--home",
        nargs=2,
        type=finite,
        metavar=("LATITUDE", "LONGITUDE"),
        help="origin of x (east) and y (north) on Earth, for .plan and .waypoints",
    )
    parser.add_argument(
        "--drop",
        action="store_true",
        help="leave out and list items that the robot cannot carry out",
    )
