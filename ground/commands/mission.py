"""Missions: upload one to the robot, download, start, stop and delete it, and read its progress."""

from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import ClassVar, Final

from ground.client.link import Link
from ground.client.outcomes import Answer, Success, refusal_words
from ground.client.requests import GaveUp
from ground.client.session import Session, refusing_holder
from ground.client.vocabulary import SHELL, Remedies
from ground.missions import files
from ground.missions.mission import Fence, Home, Mission
from ground.missions.transfer import (
    Announcement,
    Clear,
    Download,
    Downloaded,
    Transfer,
    Upload,
    Verdict,
    fence_items_of,
    fence_of,
    items_of,
    waypoints_of,
)
from protocol.outcome import mission_state
from protocol.topics import MISSION, MISSION_SERVICE
from protocol.wire.enums import Command, MissionState, MissionType
from protocol.wire.messages import CommandRequest, MissionStatus
from protocol.wire.reasons import Reason, reason_text
from runtime.errors import RemoteError

STATUS_NS: Final = 1_500_000_000
CURRENT: Final = -1
"""Starts a mission at its current item."""
NO_MISSION: Final = Verdict(Reason.NO_MISSION, None)


def send(link: Link, transfer: Transfer) -> Verdict:
    """Return the robot's verdict on an upload or a deletion; UnansweredError without one."""
    outcome = run_transfer(link, transfer)
    if not isinstance(outcome, Verdict):
        raise RemoteError("the robot sent a mission instead of a verdict")
    return outcome


def send_fence(link: Link, fence: Fence) -> Verdict:
    """Upload a fence and return the robot's verdict."""
    items = fence_items_of(fence)
    return send(link, Upload(items, MissionType.FENCE, link.clock.now_ns()))


def fetch(link: Link, kind: MissionType) -> Downloaded | Verdict:
    """Download items from the robot; a verdict if it does not send them."""
    return run_transfer(link, Download(kind, link.clock.now_ns()))


def run_transfer(link: Link, transfer: Transfer) -> Downloaded | Verdict:
    """Run a transfer to its end; UnansweredError if the robot does not answer."""
    link.exchange(transfer, MISSION_SERVICE)
    outcome = transfer.outcome
    if outcome is None or isinstance(outcome, GaveUp):
        raise link.unanswered(outcome)
    return outcome


def mission_status(link: Link) -> MissionStatus | None:
    """Return the robot's mission status; None if it publishes none."""
    return link.newest(MISSION, STATUS_NS)


@dataclass(frozen=True, slots=True, kw_only=True)
class TransferOutcome:
    """The robot's verdict on a mission or a fence; `done` is the text of a success.

    `what` names what the verdict is about.
    """

    verdict: Verdict
    done: str
    what: str = ""
    holder: str = ""
    remedies: Remedies = field(default=SHELL, compare=False, repr=False)

    @property
    def ok(self) -> bool:
        """True if the robot accepted it."""
        return self.verdict.ok

    @property
    def reason(self) -> int:
        """The `Reason` of the verdict."""
        return self.verdict.reason

    @property
    def item(self) -> int | None:
        """The item that is wrong, from 1; None if the verdict is not about one item."""
        return self.verdict.item

    @property
    def is_none(self) -> bool:
        """True if the robot has no mission."""
        return self.reason == Reason.NO_MISSION

    @property
    def text(self) -> str:
        """The text of a success, or the refusal with its remedy."""
        if self.ok:
            return self.done
        reason = f"{self.what}{self.verdict.text}"
        no = "not saved" if self.verdict.in_force else "refused"
        hints = self.remedies.refusals
        return f"{no}: {refusal_words(reason, self.verdict.reason, self.holder, hints)}"

    def as_json(self, verb: str, robot: str) -> dict[str, object]:
        """Return the verdict as a row."""
        return {
            "verb": verb,
            "robot": robot,
            "ok": self.ok,
            "reason": f"{self.what}{self.verdict.text}",
            "reason_code": self.verdict.reason,
            "item": self.verdict.item,
        }


def with_holder(link: Link, verdict: Verdict, done: str, what: str = "") -> TransferOutcome:
    """Return the verdict, with the lease holder's name if the lease is the reason."""
    return TransferOutcome(
        verdict=verdict,
        done=done,
        what=what,
        holder=refusing_holder(link, verdict.reason),
        remedies=link.common.remedies,
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class AnnounceItems:
    """Ask whether the robot accepts this number of items now; nothing is changed."""

    verb: ClassVar[str] = "mission announce"
    moves: ClassVar[bool] = True
    kind: MissionType
    count: int

    def perform(self, session: Session) -> TransferOutcome:
        """Return the robot's verdict.

        For too many items it names the first item beyond the limit.
        """
        link = session.link
        verdict = send(link, Announcement(self.count, self.kind, link.clock.now_ns()))
        return with_holder(link, verdict, "ok, the robot takes them")


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

    def perform(self, session: Session) -> TransferOutcome:
        """Upload the fence if there is one, then the mission; return the last verdict."""
        link, mission = session.link, self.mission
        if not self.anyway:
            waypoints = enumerate(mission.waypoints, start=1)
            session.refuse_outside(*((f"waypoint {at} {p}", p.x_m, p.y_m) for at, p in waypoints))
        for what in self.dropped:
            session.progress.note(f"left out: {what}")
        if mission.fence is not None:
            verdict = send_fence(link, mission.fence)
            if not verdict.in_force:
                return with_holder(link, verdict, "", "the fence: ")
            if not verdict.ok:
                session.progress.note(f"the fence: {verdict.text}")
        items = items_of(mission.waypoints)
        verdict = send(link, Upload(items, MissionType.MISSION, link.clock.now_ns()))
        return with_holder(link, verdict, f"ok, the robot has {mission}")


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

    def perform(self, session: Session) -> MissionFetched | TransferOutcome:
        """Return the mission; a verdict if the robot has none or does not send it."""
        link = session.link
        found = fetch(link, MissionType.MISSION)
        fence = fetch(link, MissionType.FENCE)
        if isinstance(found, Verdict):
            return with_holder(link, found, "")
        if not found.items:
            return with_holder(link, NO_MISSION, "")
        corners = fence.items if isinstance(fence, Downloaded) else ()
        mission = Mission(waypoints=waypoints_of(found.items), fence=fence_of(corners))
        return MissionFetched(mission)


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

    def perform(self, session: Session) -> MissionWritten | TransferOutcome:
        """Download the mission and write it; UserError for an unknown file type."""
        files.ending_of(self.file)  # refuse a wrong file type before sending a request
        found = FetchMission().perform(session)
        if isinstance(found, TransferOutcome):
            return found
        mission = replace(found.mission, home=self.home)
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

    def perform(self, session: Session) -> Answer:
        """Start the mission until the robot accepts it."""
        first = first_of(session.link) if self.item is None else self.item - 1

        def request() -> CommandRequest:
            return session.link.command(Command.MISSION_START, float(first))

        return session.ask_until_accepted(request, beats=False, arms=self.arms)[0]


def first_of(link: Link) -> int:
    """Return the item at which a mission begins by default, counted as on the wire."""
    found = mission_status(link)
    over = found is not None and found.state == MissionState.DONE
    return 0 if over else CURRENT


@dataclass(frozen=True, slots=True, kw_only=True)
class JumpTo:
    """Continue with another item of the mission, from 1."""

    verb: ClassVar[str] = "mission jump"
    moves: ClassVar[bool] = True
    item: int

    def perform(self, session: Session) -> Answer:
        """Send the command and return the robot's answer."""
        link = session.link
        request = link.command(Command.DO_SET_MISSION_CURRENT, float(self.item - 1))
        return session.with_holder(link.ask(request))


@dataclass(frozen=True, slots=True, kw_only=True)
class ClearMission:
    """Delete the mission from the robot."""

    verb: ClassVar[str] = "mission clear"
    moves: ClassVar[bool] = True

    def perform(self, session: Session) -> TransferOutcome:
        """Delete the mission and return the robot's verdict."""
        link = session.link
        verdict = send(link, Clear(MissionType.MISSION, link.clock.now_ns()))
        return with_holder(link, verdict, "ok, the robot has no mission")


@dataclass(frozen=True, slots=True)
class MissionProgress(Success):
    """The robot's mission status."""

    status: MissionStatus

    @property
    def text(self) -> str:
        """One line such as `holding, item 3 of 5, 3.2 s left`."""
        status = self.status
        if status.state == MissionState.NONE:
            return "no mission"
        left = f", {status.hold_left_ms / 1000:.1f} s left" if status.hold_left_ms else ""
        reason = f": {reason_text(status.reason)}" if status.reason else ""
        where = f"item {status.current + 1} of {status.count}"
        return f"{mission_state(status.state, status.reason).lower()}, {where}{left}{reason}"

    def as_json(self, verb: str, robot: str) -> dict[str, object]:
        """Return the status as a row; items count from 1."""
        status = self.status
        return {
            "robot": robot,
            "ok": True,
            "state": mission_state(status.state, status.reason).lower(),
            "items": status.count,
            "current": status.current + 1 if status.count else None,
            "hold_left_s": status.hold_left_ms / 1000,
            "reason": reason_text(status.reason) if status.reason else None,
        }


@dataclass(frozen=True, slots=True)
class MissionEnded(MissionProgress):
    """The end of a mission; `ok` if all items were reached."""

    @property
    def ok(self) -> bool:
        """True if all items were reached."""
        return self.status.state == MissionState.DONE


@dataclass(frozen=True, slots=True, kw_only=True)
class ShowMissionStatus:
    """Read the progress of the mission."""

    verb: ClassVar[str] = "mission status"
    moves: ClassVar[bool] = False

    def perform(self, session: Session) -> MissionProgress:
        """Return the status; RemoteError if the robot publishes none."""
        status = mission_status(session.link)
        if status is None:
            raise RemoteError(f"the robot publishes no mission status: {session.link.diagnosis()}")
        return MissionProgress(status)
