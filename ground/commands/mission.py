"""Missions: upload one to the robot, download, start, stop and delete it, and read its progress."""

from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import ClassVar

from ground.client.missions import MissionProgress, TransferOutcome
from ground.client.outcomes import Answer, Refused, Success
from ground.missions import files
from ground.missions.mission import Home, Mission
from ground.robot import Robot
from protocol.wire.enums import MissionType


@dataclass(frozen=True, slots=True, kw_only=True)
class AnnounceItems:
    """Ask whether the robot accepts this number of items now; nothing is changed."""

    verb: ClassVar[str] = "mission announce"
    moves: ClassVar[bool] = True
    kind: MissionType
    count: int

    async def perform(self, robot: Robot) -> TransferOutcome | Refused:
        """Return the robot's verdict.

        For too many items it names the first item beyond the limit.
        """
        return await robot.mission.announce(self.kind, self.count)


@dataclass(frozen=True, slots=True, kw_only=True)
class UploadMission:
    """Upload a mission, whole or not at all; `dropped` was left out of its file.

    The fence goes first, so that the robot checks the mission against it. A waypoint outside of the
    known world is an error, unless `anyway` is set.
    """

    verb: ClassVar[str] = "mission upload"
    moves: ClassVar[bool] = True
    mission: Mission
    dropped: tuple[str, ...] = ()
    anyway: bool = False

    async def perform(self, robot: Robot) -> TransferOutcome | Refused:
        """Upload the fence if there is one, then the mission; return the last verdict."""
        if not self.anyway:
            waypoints = enumerate(self.mission.waypoints, start=1)
            places = ((f"waypoint {at} {place}", place.x_m, place.y_m) for at, place in waypoints)
            await robot.refuse_outside(*places)
        for what in self.dropped:
            robot.progress.note(f"left out: {what}")
        return await robot.mission.upload(self.mission)


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
        waypoints = [asdict(waypoint) for waypoint in self.mission.waypoints]
        return {"verb": verb, "ok": True, "waypoints": waypoints}


@dataclass(frozen=True, slots=True, kw_only=True)
class FetchMission:
    """Download the robot's mission, with its fence."""

    verb: ClassVar[str] = "mission list"
    moves: ClassVar[bool] = False

    async def perform(self, robot: Robot) -> MissionFetched | TransferOutcome:
        """Return the mission; a verdict if the robot has none or does not send it."""
        found = await robot.mission.download()
        return MissionFetched(found) if isinstance(found, Mission) else found


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


@dataclass(frozen=True, slots=True, kw_only=True)
class DownloadMission:
    """Write the robot's mission to a file; `home` is where x and y are 0 on Earth."""

    verb: ClassVar[str] = "mission download"
    moves: ClassVar[bool] = False
    file: Path
    home: Home | None = None

    async def perform(self, robot: Robot) -> MissionWritten | TransferOutcome:
        """Download the mission and write it; UserError for an unknown file type."""
        files.ending_of(self.file)  # refuse a wrong file type before sending a request
        found = await robot.mission.download()
        if isinstance(found, TransferOutcome):
            return found
        mission = replace(found, home=self.home)
        return MissionWritten(self.file, mission, files.write(self.file, mission))


@dataclass(frozen=True, slots=True, kw_only=True)
class StartMission:
    """Start the robot's mission at an item (from 1 on); with `arms`, arm a robot in standby.

    Without an item the mission continues at the current one, or starts again if it is complete.
    """

    verb: ClassVar[str] = "mission start"
    moves: ClassVar[bool] = True
    item: int | None = None
    arms: bool = True

    async def perform(self, robot: Robot) -> Answer:
        """Start the mission until the robot accepts it."""
        return await robot.mission.start(self.item, arms=self.arms)


@dataclass(frozen=True, slots=True, kw_only=True)
class JumpTo:
    """Continue with another item of the mission, from 1."""

    verb: ClassVar[str] = "mission jump"
    moves: ClassVar[bool] = True
    item: int

    async def perform(self, robot: Robot) -> Answer:
        """Send the command and return the robot's answer."""
        return await robot.mission.jump(self.item)


@dataclass(frozen=True, slots=True, kw_only=True)
class ClearMission:
    """Delete the mission from the robot."""

    verb: ClassVar[str] = "mission clear"
    moves: ClassVar[bool] = True

    async def perform(self, robot: Robot) -> TransferOutcome | Refused:
        """Delete the mission and return the robot's verdict."""
        return await robot.mission.clear()


@dataclass(frozen=True, slots=True, kw_only=True)
class ShowMissionStatus:
    """Read the progress of the mission."""

    verb: ClassVar[str] = "mission status"
    moves: ClassVar[bool] = False

    async def perform(self, robot: Robot) -> MissionProgress:
        """Return the status; RemoteError if the robot publishes none."""
        return await robot.mission.status()
