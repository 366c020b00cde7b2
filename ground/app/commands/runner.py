"""Run the commands of the app, from keys and from typed lines."""

import shlex
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Final

from ground.app.commands.undo import UNDONE, Change, Restore, TakeBack, Undoable, UndoList
from ground.app.input.key_queue import CONFIRM_WITHIN_S, SecondPress
from ground.client.connection import Common
from ground.client.floor import Floor, floor_in
from ground.client.outcomes import Answer, Outcome
from ground.client.presence import dial_options
from ground.client.requests import GaveUp
from ground.client.teleop_sender import TeleopSender
from ground.commands.command import OperatorCommand
from ground.commands.goto import Goto
from ground.commands.lease import ChangeLease
from ground.commands.mission import OfMissionFile
from ground.commands.mode import SetMode
from ground.commands.stop import ClearAll, ClearEmergencyStop, StopAll, StopNow
from ground.console.app_commands import AddWaypoint, AppCommand, DraftCommand, Undo
from ground.console.argument_errors import shown
from ground.console.completion import Assistance, Candidate, assist
from ground.console.history import History
from ground.console.parser import COMMANDS, expanded, read, words_of
from ground.map.scene import MapTarget
from ground.missions.files import Draft
from ground.missions.mission import Mission
from ground.robot import Robot
from ground.station.robot.command_queue import REPLAYED, Ended, JobResult
from ground.station.robot.mission_items import targets_of
from ground.station.station import Station
from protocol.topics import COMMAND
from protocol.wire.enums import Command, Mode, Severity
from runtime.cli.verb_table import with_present_name
from runtime.errors import RemoteError, UserError

MANUAL: Final = SetMode(mode=Mode.MANUAL)
HOLD: Final = SetMode(mode=Mode.HOLD)
OVER: Final = "the drive by hand was already over"


class CommandRunner:
    """Runs commands of keys and typed lines.

    `local` performs commands for the screen and returns their message.
    """

    def __init__(self, station: Callable[[], Station], common: Common, history: History) -> None:
        """Create a runner. `station` is called each time."""
        self._station_now, self._common = station, common
        self._history = history
        self._drive: DriveByKeys | None = None
        self.local: Callable[[AppCommand], str] = refuse
        self.draft = Draft()
        self._undo_list = UndoList()
        self.last = ""
        self._undoing = SecondPress(lambda: self._station.time_s)

    @property
    def _station(self) -> Station:
        return self._station_now()

    def run_line(self, line: str) -> None:
        """Run a line that was typed."""
        if not line:
            return
        try:
            command = read(line)
        except UserError as error:
            self._history.add(line)
            self._station.note(f"{shown(line)}: {error}", Severity.WARNING)
            return
        self.perform(command, line)

    def perform(self, command: OperatorCommand, line: str = "") -> None:
        """Perform a command; `line` is the line as it was typed, if it was."""
        line = line or command.line
        match command:  # a stop waits for no disk
            case StopNow():
                self._station.estop()
            case StopAll():
                self._station.estop_all()
        self._history.add(line)
        self.last = self._for_a_shell(line)
        if isinstance(command, ClearEmergencyStop):
            command = replace(command, stop_ids=self._station.stops_known(self._station.robot))
        elif isinstance(command, ClearAll):
            command = replace(command, stop_ids=self._station.all_stops_known())
        elif isinstance(command, OfMissionFile):  # `-` is the draft: there is no standard input
            command = replace(command, draft=lambda: self.draft.ready)
        match command:
            case StopNow() | StopAll():
                pass
            case ChangeLease(action=action):
                self._station.queue.lease(action)
            case AppCommand():
                self._locally(command)
            case _:
                told: Any = OnFiles(command) if command.is_offline else command
                is_undone = isinstance(command, UNDONE)
                changes, station = self._undo_list, self._station
                witness = Undoable(command, line, changes, station) if is_undone else None
                station.queue.submit(line, told, moves=command.moves, witness=witness)

    def begin_world(self, *, keeps_draft: bool) -> None:
        """Remove the changes of robots that have ended; also the draft, unless it is kept."""
        self._undo_list = self._undo_list.in_new_world(keeps_draft=keeps_draft)
        if not keeps_draft:
            self.draft = Draft()

    @property
    def draft_items(self) -> tuple[MapTarget, ...]:
        """The waypoints of the mission draft."""
        return targets_of(self.draft.mission)

    def assist(self, text: str) -> Assistance:
        """Return the completions of a line, verbs that were used often first, and a hint."""
        return assist(text, self._station.parameters or (), self._history.uses())

    def search(self, words: str) -> Assistance:
        """Return the earlier lines that contain these words, the newest first."""
        return Assistance(tuple(Candidate(line, line) for line in self._history.search(words)))

    def recall(self, text: str, step: int) -> str:
        """Return an earlier (step -1) or later (1) line."""
        return self._history.previous(text) if step < 0 else self._history.next(text)

    # Teleop.

    def begin_teleop(self) -> bool:
        """Switch to MANUAL, then send teleop commands. Return False when refused."""
        if not self._station.live:
            self._station.note(REPLAYED, Severity.WARNING)
            return False
        drive = DriveByKeys()
        begun = self._station.queue.submit(MANUAL.line, drive)
        self._drive = drive if begun else None
        return begun

    def steer(self, speed_m_s: float, yaw_rate_rad_s: float) -> None:
        """Send a teleop command."""
        if self._drive is not None:
            self._drive.steer(speed_m_s, yaw_rate_rad_s)

    def end_teleop(self) -> None:
        """Stop the robot and switch to HOLD, unless something else drives it meanwhile."""
        drive, self._drive = self._drive, None
        if drive is not None:
            drive.steer(0.0, 0.0)
            self._station.queue.submit(HOLD.line, EndOfDrive(drive), moves=False)

    def _floor(self) -> Floor | None:
        """Return the floor of the robot's world, if it is known."""
        world = self._station.world
        return None if world is None else floor_in(world.text)

    def _undo(self) -> str:
        """Undo the last change; a pending command may make one, so it is ended first."""
        station, robot = self._station, self._station.robot
        if station.queue.busy:
            station.queue.submit("undo", TakeBack(self._undo_list, robot, self._restore_draft))
            return ""
        newest = self._undo_list.newest
        if (
            newest is not None
            and newest.robot == robot
            and isinstance(newest.back, Goto)
            and not self._undoing.is_second(newest.line)
        ):
            within = f"undo again within {CONFIRM_WITHIN_S:g} s"
            return f"{within} to drive to the goal before: {newest.back.line}"
        change = self._undo_list.take(robot)
        if isinstance(change.back, Mission):
            return self._restore_draft(change, change.back)
        assert change.back is not None, "refused by take()"
        words = f"undo {change.line}: {change.back.line}"
        if not station.queue.submit(words, Restore(self._undo_list, change)):
            self._undo_list.add(change)
        return ""

    def _restore_draft(self, change: Change, before: Mission) -> str:
        self.draft.mission = before
        return f"undone: {change.line}; {self.draft.listed()}"

    def _edit(self, command: DraftCommand) -> str:
        """Edit the draft, and remember how to take it back."""
        before = self.draft.mission
        message = command.edit(self.draft)
        if self.draft.mission != before:
            self._undo_list.add(Change(self._station.robot, command.line, before))
        return message

    def _locally(self, command: AppCommand) -> None:
        severity = Severity.INFO
        try:
            message = self._message_of(command)
        except (UserError, RemoteError) as error:
            message, severity = str(error), Severity.WARNING
        for text in message.splitlines():
            self._station.note(text, severity)

    def _message_of(self, command: AppCommand) -> str:
        if isinstance(command, Undo):
            return self._undo()
        if isinstance(command, AddWaypoint) and (floor := self._floor()) is not None:
            place = command.waypoint
            floor.refuse_outside(f"waypoint {place}", place.x_m, place.y_m)
        return self._edit(command) if isinstance(command, DraftCommand) else self.local(command)

    def _for_a_shell(self, line: str) -> str:
        words = expanded(words_of(line))
        if words[0] in COMMANDS:  # not a command of the app
            words = with_present_name(words)
        words = ["sidestep", *words]
        if self._station.robot != "r1":
            words += ["--id", self._station.robot]
        return shlex.join(words) + dial_options(self._common.endpoint, self._common.config)


class DriveByKeys:
    """One drive by hand: it begins by MANUAL, and its speeds follow."""

    def __init__(self) -> None:
        self.request_id = 0
        """That of the request which began it; 0 before that was sent."""
        self._stick: TeleopSender | None = None

    async def perform(self, robot: Robot) -> Answer:
        """Choose MANUAL; then send zero speed once."""
        request = robot.request(Command.DO_SET_MODE, 1.0, float(Mode.MANUAL))
        self.request_id = request.request_id
        answer = await robot.ask(request)
        if answer.ok:
            stick = TeleopSender(robot.bus, robot.name, robot.clock)
            await robot.in_own_thread(stick.open)
            self._stick = stick
            stick.stop()
        return answer

    def steer(self, speed_m_s: float, yaw_rate_rad_s: float) -> None:
        """Send speeds once, unless it has not begun."""
        if self._stick is not None:
            self._stick.drive(speed_m_s, yaw_rate_rad_s)


@dataclass(frozen=True, slots=True)
class EndOfDrive:
    """Ends a drive by hand, and no other."""

    drive: DriveByKeys

    async def perform(self, robot: Robot) -> Ended:
        """Choose HOLD; UnansweredError without an answer."""
        hold = robot.request(Command.DO_SET_MODE, 1.0, float(Mode.HOLD))
        outcome = await robot.end(hold, self.drive.request_id)
        if isinstance(outcome, GaveUp):
            raise await robot.unanswered(outcome, COMMAND)
        return outcome or JobResult(True, OVER)


@dataclass(frozen=True, slots=True)
class OnFiles:
    """A command that works on files alone, and so for long: in a thread of its own."""

    command: Any

    async def perform(self, robot: Robot) -> Outcome:
        """Carry it out."""
        outcome: Outcome = await robot.in_own_thread(lambda: self.command.run(robot.progress))
        return outcome


def refuse(command: AppCommand) -> str:
    """Refuse a command for the screen."""
    raise UserError("not available on this screen")
