"""Run the commands of the app, from keys and from typed lines, outside of the UI thread."""

import shlex
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Final

from ground.app.commands.undo import Change, UndoList, inverse_of
from ground.blocking import perform
from ground.client.connection import Common
from ground.client.floor import Floor, floor_in
from ground.client.link import Link
from ground.client.outcomes import Answer, Outcome, Refused
from ground.client.requests import ATTEMPTS, GaveUp
from ground.client.session import Operation, Session
from ground.client.teleop_sender import TeleopSender
from ground.client.vocabulary import HINTS
from ground.commands.all_robots import ClearAll, StopAll
from ground.commands.lease import ChangeLease
from ground.commands.mode import SetMode
from ground.commands.stop import ClearEmergencyStop, StopNow
from ground.console.app_commands import AppCommand, Undo
from ground.console.argument_errors import shown
from ground.console.completion import Assistance, Candidate, assist
from ground.console.history import History
from ground.console.parser import COMMANDS, expanded, read, words_of
from ground.console.spelling import line_of
from ground.map.scene import MapTarget
from ground.missions.draft import AddWaypoint, Draft, Edit
from ground.missions.mission import Mission
from ground.station.robot.background_requests import JobResult
from ground.station.robot.mission_items import target_of
from ground.station.station import REPLAYED, Station
from protocol.bus.bus import Bus
from protocol.options import DEFAULT_ENDPOINT
from protocol.wire.enums import Command, LeaseAction, Mode, Severity
from runtime.cli.verb_table import with_present_name
from runtime.clock import Clock
from runtime.errors import RemoteError, UserError

MANUAL: Final = SetMode(mode=Mode.MANUAL)
HOLD: Final = SetMode(mode=Mode.HOLD)
OVER: Final = "the drive by hand was already over"


class CommandRunner:
    """Runs commands of keys and typed lines.

    `local` performs commands for the screen and returns their message. `hints` are the remedies of
    refusals by reason.
    """

    def __init__(
        self,
        station: Callable[[], Station],
        bus: Bus | None,
        common: Common,
        clock: Clock,
        history: History,
    ) -> None:
        """Create a runner. `station` is called each time; without a `bus` there is no robot."""
        self._station_now = station
        self._bus, self._common, self._clock = bus, common, clock
        self._history = history
        self._drive: DriveByKeys | None = None
        self.local: Callable[[AppCommand], str] = refuse
        self.hints = HINTS
        self.draft = Draft()
        self._undo_list = UndoList()
        self.last = ""

    @property
    def _station(self) -> Station:
        return self._station_now()

    def run_line(self, line: str) -> None:
        """Run a line that was typed."""
        if not line:
            return
        try:
            command = read(line, lambda: self.draft.text)
        except UserError as error:
            self._history.add(line)
            self._station.note(f"{shown(line)}: {error}", Severity.WARNING)
            return
        self.perform(command, line)

    def perform(self, command: Operation[Outcome] | AppCommand, line: str = "") -> None:
        """Perform a command; `line` is the line as it was typed, if it was."""
        line = line or line_of(command)
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
        match command:
            case StopNow() | StopAll():
                pass
            case ChangeLease(action=LeaseAction.RELEASE):
                self._station.release_lease()
            case ChangeLease(action=action):
                self._station.take_lease(seize=action is LeaseAction.SEIZE)
            case _ if isinstance(command, AppCommand):
                self._locally(command)
            case _:
                job = partial(self._done, command, line, self._station.robot)
                self._station.submit(line, job, moves=command.moves)

    def is_local(self, line: str) -> bool:
        """Return whether a line concerns only the screen."""
        try:
            command = read(line)
            return isinstance(command, AppCommand) and not isinstance(command, Undo)
        except UserError:
            return True  # a wrong line only causes a message

    def begin_world(self, *, keeps_draft: bool) -> None:
        """Remove the changes of robots that have ended; also the draft, unless it is kept."""
        self._undo_list = self._undo_list.in_new_world(keeps_draft=keeps_draft)
        if not keeps_draft:
            self.draft = Draft()

    @property
    def draft_items(self) -> tuple[MapTarget, ...]:
        """The waypoints of the mission draft."""
        return tuple(map(target_of, self.draft.mission.waypoints))

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
        if self._bus is None:
            self._station.note(REPLAYED, Severity.WARNING)
            return False
        drive = DriveByKeys(self._link(self._station.robot))

        def begin() -> JobResult:
            return self._result(drive.begin())

        begun = self._station.submit(line_of(MANUAL), begin)
        self._drive = drive if begun else None
        return begun

    def steer(self, speed_m_s: float, yaw_rate_rad_s: float) -> None:
        """Send a teleop command."""
        if self._drive is not None:
            self._drive.stick.drive(speed_m_s, yaw_rate_rad_s)

    def end_teleop(self) -> None:
        """Stop the robot and switch to HOLD, unless something else drives it meanwhile."""
        drive, self._drive = self._drive, None
        if drive is None:
            return

        def end() -> JobResult:
            outcome = drive.end()
            return JobResult(True, OVER) if outcome is None else self._result(outcome)

        drive.stick.stop()
        self._station.submit(line_of(HOLD), end, moves=False)

    def _done(self, operation: Operation[Outcome], line: str = "", robot: str = "") -> JobResult:
        """Perform an operation in another thread, for the robot that was shown when it was given.

        It has its own link, so that request ids are unique. With the `line` that was typed, it can
        be undone.
        """
        station, undo_list = self._station, self._undo_list
        robot = robot or station.robot
        parameters = station.parameters or () if station.robot == robot else ()
        session = Session(self._link(robot), attended=True, floor=self._floor)
        back = inverse_of(operation, parameters, session) if line else None
        outcome = perform(operation, session)
        if line:
            undo_list.note(robot, line, operation, outcome, back)
        return self._result(outcome)

    def _result(self, outcome: Outcome) -> JobResult:
        """Return an outcome in words; a refusal names the keys of the app that remedy it."""
        text = outcome.in_words(self.hints) if isinstance(outcome, Refused) else outcome.text
        return JobResult(outcome.ok, text)

    def _floor(self) -> Floor | None:
        """Return the floor of the robot's world, if it is known."""
        world = self._station.world
        return None if world is None else floor_in(world.text)

    def _undo(self) -> str:
        """Undo the last change; a pending request may make one, so it is ended first."""
        station, robot = self._station, self._station.robot
        if not station.busy:
            return self._take_back(robot)
        station.submit("undo", partial(self._take_back_in_turn, robot))
        return ""

    def _take_back_in_turn(self, robot: str) -> JobResult:
        change = self._undo_list.take(robot)
        if isinstance(change.back, Mission):
            return JobResult(True, self._restore_draft(change, change.back))
        outcome = self._restore(change, robot)
        return outcome._replace(text=f"{change.line}: {outcome.text}")

    def _take_back(self, robot: str) -> str:
        change = self._undo_list.take(robot)
        if isinstance(change.back, Mission):
            return self._restore_draft(change, change.back)
        assert change.back is not None, "refused by take()"
        words = f"undo {change.line}: {line_of(change.back)}"
        if not self._station.submit(words, partial(self._restore, change, robot)):
            self._undo_list.add(change)
        return ""

    def _restore_draft(self, change: Change, before: Mission) -> str:
        self.draft.mission = before
        return f"undone: {change.line}; {self.draft.listed()}"

    def _restore(self, change: Change, robot: str) -> JobResult:
        """Restore the state before a change of a robot.

        After a refusal the change can be undone again.
        """
        undo_list, back = self._undo_list, change.back
        assert back is not None, "refused by take()"
        assert not isinstance(back, Mission), "the draft is restored without a request"
        outcome = self._done(back, robot=robot)
        if not outcome.ok:
            undo_list.add(change)
        return outcome

    def _edit(self, command: Edit) -> str:
        """Edit the draft, and remember how to take it back."""
        before = self.draft.mission
        message = self.draft.apply(command)
        if self.draft.mission != before:
            self._undo_list.add(Change(self._station.robot, line_of(command), before))
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
        return self._edit(command) if isinstance(command, Edit) else self.local(command)

    def _link(self, robot: str) -> Link:
        """Return a link to a robot."""
        if self._bus is None:
            raise UserError(REPLAYED)
        common = replace(self._common, robot=robot)
        return Link(self._bus, common, self._clock)

    def _for_a_shell(self, line: str) -> str:
        words = expanded(words_of(line))
        if words[0] in COMMANDS:  # not a command of the app
            words = with_present_name(words)
        words = ["sidestep", *words]
        if self._station.robot != "r1":
            words += ["--id", self._station.robot]
        if self._common.endpoint != DEFAULT_ENDPOINT:
            words += ["--connect", self._common.endpoint]
        return shlex.join(words)


class DriveByKeys:
    """One drive by hand: the command that begins it, its speeds, and the one that ends it."""

    def __init__(self, link: Link) -> None:
        self.stick = TeleopSender(link.bus, link.robot, link.clock)
        self._link = link
        self._id = 0

    def begin(self) -> Answer:
        """Choose MANUAL; then send zero speed once."""
        request = self._link.command(Command.DO_SET_MODE, 1.0, float(Mode.MANUAL))
        self._id = request.request_id
        answer = Session(self._link, attended=True).with_holder(self._link.ask(request))
        if answer.ok:
            self.stick.stop()
        return answer

    def end(self) -> Answer | None:
        """Choose HOLD for this drive, and for no other; None if it is over."""
        hold = self._link.command(Command.DO_SET_MODE, 1.0, float(Mode.HOLD))
        outcome = self._link.end(hold, self._id, attempts=ATTEMPTS)
        if isinstance(outcome, GaveUp):
            raise self._link.unanswered(outcome)
        return outcome


def refuse(command: AppCommand) -> str:
    """Refuse a command for the screen."""
    raise UserError("not available on this screen")
