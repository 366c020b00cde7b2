"""`mission`: check a mission file, upload it to the robot, start, stop and delete the mission."""

import sys
from collections.abc import Callable
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Final

from ground.client.missions import MissionProgress, TransferOutcome
from ground.client.outcomes import Answer, GoalEnded, Progress, Refused, Success
from ground.commands.abort import Abort
from ground.commands.command import (
    ANYWAY,
    FileCommand,
    Group,
    OperatorCommand,
    command,
    option,
    place,
    switch,
)
from ground.commands.resume import Resume
from ground.missions import files
from ground.missions.mission import Home, Mission, Step
from ground.missions.qgroundcontrol import Foreign, home_at
from ground.robot import Robot
from protocol.options import finite, whole
from protocol.wire.enums import MissionType
from runtime.cli.verb import MORE
from runtime.errors import UserError

MISSION: Final = Group(
    MORE,
    20,
    "mission upload mission.toml",
    "waypoints: check, send, start, pause, jump, fetch, convert",
    suffixes=files.ENDINGS,
)
DRAFT: Final = "wp upload"
"""The line of the app that uploads its draft."""
MOST_ITEMS: Final = 65_535
BYTE_ORDER_MARK: Final = "\ufeff"
"""Limit of an item's number; people count from 1, the wire from 0."""
item_number: Final = whole(1, MOST_ITEMS)


@dataclass(frozen=True, slots=True, kw_only=True)
class OfMissionFile(OperatorCommand):
    """A command on a mission file; `-` is standard input, or the mission that `draft` returns.

    `home` is where x and y are 0 on Earth. `drop`: leave out items that the robot cannot carry out.
    """

    file: Path = place("FILE", ".toml, .plan or .waypoints", parse=Path)
    home: Home | None = option(
        "--home",
        default=None,
        parse=finite,
        metavar=("LATITUDE", "LONGITUDE"),
        help="origin of x (east) and y (north) on Earth, for .plan and .waypoints",
        joined=lambda numbers: home_at(*numbers),
        spelt=lambda home: f"{home.latitude_deg!r} {home.longitude_deg!r}",
    )
    drop: bool = switch(
        "--drop", default=False, help="leave out and list items that the robot cannot carry out"
    )
    draft: Callable[[], Mission] | None = field(default=None, compare=False)

    def found(self) -> Foreign:
        """Read the mission; MissionError names all faults of the file."""
        if self.file != files.DASH:
            return files.read(self.file, home=self.home, drop=self.drop)
        if self.draft is not None:
            mission = self.draft()
            return Foreign(replace(mission, home=self.home or mission.home))
        text = sys.stdin.read(files.LARGEST_BYTES).removeprefix(BYTE_ORDER_MARK)
        return files.read_text(text, self.file, home=self.home, drop=self.drop)


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


@command(MISSION, example="mission check mission.toml")
class CheckMission(OfMissionFile, FileCommand):
    """Report the faults of a mission file."""

    def run(self, progress: Progress) -> MissionChecked:
        """Check the file without a robot."""
        found = self.found()
        note_dropped(found.dropped, progress)
        return MissionChecked(found)


@command(word="mission upload", moves=True)
class UploadMission(OperatorCommand):
    """Upload a mission, whole or not at all; `dropped` was left out of its file.

    A waypoint outside of the known world is an error, unless `anyway` is set.
    """

    mission: Mission
    dropped: tuple[str, ...] = ()
    anyway: bool = False

    async def perform(self, robot: Robot) -> TransferOutcome | Refused:
        """Upload the fence if there is one, then the mission; return the last verdict."""
        if not self.anyway:
            listed = self.mission.places
            places = [(f"waypoint {at} {one}", one.x_m, one.y_m) for at, one in listed]
            await robot.refuse_outside(*places)
        note_dropped(self.dropped, robot.progress)
        return await robot.mission.upload(self.mission)


@command(
    MISSION,
    example="mission upload mission.toml",
    moves=True,
    also={DRAFT: (str(files.DASH),)},
)
class UploadMissionFile(OfMissionFile):
    """Send a mission and its fence, if any, to the robot."""

    anyway: bool = switch("--anyway", default=False, help=ANYWAY.format("waypoints"))

    @property
    def line(self) -> str:
        """The line that would be typed for it in the app."""
        if self.file == files.DASH and not (self.home or self.drop or self.anyway):
            return DRAFT
        return super(UploadMissionFile, self).line  # noqa: UP008 - slots make a new class

    def read(self) -> UploadMission:
        """Read the file."""
        found = self.found()
        return UploadMission(mission=found.mission, dropped=found.dropped, anyway=self.anyway)

    async def perform(self, robot: Robot) -> TransferOutcome | Refused:
        """Read the file and upload the mission."""
        return await self.read().perform(robot)


@dataclass(frozen=True, slots=True)
class MissionWritten(Success):
    """A mission in a file; `lost` names what the file format cannot hold."""

    file: Path
    mission: Mission
    lost: tuple[str, ...]

    @property
    def text(self) -> str:
        """The file, and what it cannot hold."""
        return files.written(self.file, self.mission, self.lost)

    def as_json(self, verb: str, robot: str) -> dict[str, object]:
        """Return file, number of items and losses as a row."""
        row: dict[str, object] = {"verb": verb, "ok": True, "file": str(self.file)}
        return row | {"items": len(self.mission.waypoints), "lost": list(self.lost)}


@command(MISSION, example="mission download fetched.plan")
class DownloadMission(OfMissionFile):
    """Write the robot's mission to a file."""

    async def perform(self, robot: Robot) -> MissionWritten | TransferOutcome:
        """Download the mission and write it; UserError for an unknown file type."""
        files.ending_of(self.file)  # refuse a wrong file type before sending a request
        found = await robot.mission.download()
        if isinstance(found, TransferOutcome):
            return found
        mission = replace(found, home=self.home)
        return MissionWritten(self.file, mission, files.write(self.file, mission))


@dataclass(frozen=True, slots=True)
class MissionFetched(Success):
    """The robot's mission, with its fence."""

    mission: Mission

    @property
    def text(self) -> str:
        """One line per waypoint, then the fence."""
        waypoints = enumerate(self.mission.waypoints, start=1)
        rows = [f"{at}  {waypoint}" for at, waypoint in waypoints]
        rows += [f"fence: {self.mission.fence}"] if self.mission.fence else []
        return "\n".join(rows)

    def as_json(self, verb: str, robot: str) -> dict[str, object]:
        """Return the waypoints as a row."""
        steps = [step_row(step) for step in self.mission.waypoints]
        return {"verb": verb, "ok": True, "waypoints": steps}


def step_row(step: Step) -> dict[str, object]:
    """Return a step as JSON has it: a waypoint without the item that it was."""
    row: dict[str, object] = asdict(step)
    row.pop("mavlink", None)
    return row


@command(MISSION, example="mission list --json")
class FetchMission(OperatorCommand):
    """Show the items of the robot's mission.

    Its fence is shown, too.
    """

    async def perform(self, robot: Robot) -> MissionFetched | TransferOutcome:
        """Return the mission; a verdict if the robot has none or does not send it."""
        found = await robot.mission.download()
        return MissionFetched(found) if isinstance(found, Mission) else found


@command(
    MISSION,
    example="mission start 2",
    moves=True,
    begins=True,
    also={"mission restart": ("1",)},
)
class StartMission(OperatorCommand):
    """Drive the mission, from an item on.

    Without an item the mission continues at the current one, or begins again if it is complete.
    `arms`: arm a robot in standby.
    """

    item: int | None = place(
        "ITEM",
        "from 1; without it the current one, or the first of a mission that is done",
        default=None,
        parse=item_number,
    )
    arms: bool = True

    async def perform(self, robot: Robot) -> Answer:
        """Start the mission until the robot accepts it."""
        return await robot.mission.start(self.item, arms=self.arms)


@command(MISSION, example="mission pause", only_stops=True)
class PauseMission(OperatorCommand):
    """Stop, and keep the mission."""

    async def perform(self, robot: Robot) -> Answer:
        """Hold, and say at which item the mission is paused."""
        return await robot.mission.pause()


@command(MISSION, example="mission resume", moves=True, begins=True)
class ResumeMission(Resume):
    """Continue the mission.

    Also one that was ended early, by another goal for example.
    """

    timeout_s: float | None = None

    async def perform(self, robot: Robot) -> Answer | GoalEnded:
        """Send it and return the robot's answer."""
        return await robot.mission.resume()


@command(MISSION, example="mission abort --id r2", only_stops=True)
class AbortMission(Abort):
    """Cancel the mission and stop."""

    timeout_s: float | None = None


@command(MISSION, example="mission jump 3", moves=True, begins=True)
class JumpTo(OperatorCommand):
    """Continue with another item."""

    item: int = place("ITEM", "from 1", parse=item_number)

    async def perform(self, robot: Robot) -> Answer:
        """Send the command and return the robot's answer."""
        return await robot.mission.jump(self.item)


@command(MISSION, example="mission status --json")
class ShowMissionStatus(OperatorCommand):
    """Show the progress of the mission."""

    async def perform(self, robot: Robot) -> MissionProgress:
        """Return the status; RemoteError if the robot publishes none."""
        return await robot.mission.status()


@command(MISSION, example="mission clear --id r2", moves=True)
class ClearMission(OperatorCommand):
    """Delete the mission from the robot."""

    async def perform(self, robot: Robot) -> TransferOutcome | Refused:
        """Delete the mission and return the robot's verdict."""
        return await robot.mission.clear()


@command(MISSION, example="mission convert mission.toml mission.plan")
class ConvertMission(OfMissionFile, FileCommand):
    """Convert between formats of mission files, chosen by the suffixes."""

    file: Path = place("IN", parse=Path)
    out: Path = place("OUT", parse=Path)

    def run(self, progress: Progress) -> MissionChecked:
        """Read the file, and write it in the format of the suffix of `out`."""
        found = self.found()
        if self.out.resolve() == self.file.resolve():
            raise UserError(f"{self.out} is also the input: give another name")
        lost = files.write(self.out, found.mission)
        note_dropped(found.dropped, progress)
        return MissionChecked(found, self.out, lost)


@command(word="mission announce", moves=True)
class AnnounceItems(OperatorCommand):
    """Ask whether the robot accepts this number of items now; nothing is changed."""

    kind: MissionType
    count: int

    async def perform(self, robot: Robot) -> TransferOutcome | Refused:
        """Return the robot's verdict."""
        return await robot.mission.announce(self.kind, self.count)


def note_dropped(dropped: tuple[str, ...], progress: Progress) -> None:
    """List what was left out of a mission file."""
    for what in dropped:
        progress.note(f"left out: {what}")
