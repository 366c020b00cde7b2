"""COMMAND_LONG, COMMAND_INT and SET_MODE: execute each command once, and acknowledge it.

The results: TEMPORARILY_REJECTED for a state that ends without action, FAILED for one that the
operator must end first, DENIED for a value that is never accepted.

A client or the network repeats a command, which is executed once. A copy made by the network has
the sequence number of its original and follows it closely: it gets no answer, which the client
would take for that to its next command. A client that received no answer sends the command again,
with a higher `confirmation` or unchanged. The same command counts as new if the client has sent
another one since, or some time later.

The earlier answer is given again only while what the command has made is still there. Otherwise the
same frame has no effect and no answer, and the robot is asked again. A repetition with a
`confirmation` is no new wish of its sender: if somebody has stopped the robot since, it does not
undo that.
"""

from collections import Counter, OrderedDict
from collections.abc import Awaitable, Callable, Mapping
from dataclasses import dataclass
from enum import Enum, auto
from math import isfinite, nan
from struct import Struct
from types import MappingProxyType
from typing import Final, NamedTuple

from gateways.mavlink.mav_service import NEWCOMER, WATCHER, MavService, Sender
from gateways.mavlink.mav_vehicle import MavVehicle
from gateways.mavlink.mavlink_dialect import RESULT_NOT_IN_CONTROL, MavMessage, mavlink
from gateways.mavlink.motion.setpoints import GLOBAL_FRAMES
from gateways.mavlink.robot_port import KEEPS_FENCE, NO_TELEMETRY, OVERTAKEN, Answered
from ground.client.outcomes import Outcome
from ground.client.parameters import ParameterChanged
from protocol.wire.enums import GoalState, Mode, Severity
from protocol.wire.enums import Vehicle as VehicleState
from protocol.wire.reasons import Reason, reason_text
from runtime.units import NS_PER_MS, NS_PER_S

INT_UNKNOWN: Final = 0x7FFFFFFF
"""The x or y of a COMMAND_INT that is not set."""
CONTENT: Final = Struct("<7dh")


class CommandCall(NamedTuple):
    """A command with its parameters; NaN is a parameter that is not set.

    `x`, `y` and `z` are parameters 5 to 7. `frame` is None for a COMMAND_LONG, whose x and y are
    degrees; those of a COMMAND_INT are degrees times 1e7.
    """

    number: int
    param1: float
    param2: float
    param3: float
    param4: float
    x: float
    y: float
    z: float
    frame: int | None
    sender: Sender
    now_ns: int

    @property
    def content(self) -> bytes:
        """The parameters as bytes, by which NaN equals NaN."""
        frame = -1 if self.frame is None else self.frame
        return CONTENT.pack(*self[1:8], frame)

    @property
    def is_global(self) -> bool:
        """True if x and y are a latitude and a longitude."""
        return self.frame is None or self.frame in GLOBAL_FRAMES

    @property
    def latitude_deg(self) -> float:
        """The latitude; NaN if it is not set."""
        return self.x if self.frame is None else self.x / 1e7

    @property
    def longitude_deg(self) -> float:
        """The longitude; NaN if it is not set."""
        return self.y if self.frame is None else self.y / 1e7


def whole(value: float) -> int | None:
    """Return a parameter that must be a whole number; None if it is not one."""
    return int(value) if isfinite(value) and value == int(value) else None


def is_unset(value: float) -> bool:
    """Return whether a parameter is 0 or NaN: clients send these values in unused parameters."""
    return value == 0.0 or value != value


def call_of(message: MavMessage, sender: Sender, now_ns: int) -> CommandCall:
    """Return the command in a message."""
    if message.get_msgId() == mavlink.MAVLINK_MSG_ID_SET_MODE:
        number, rest = mavlink.MAV_CMD_DO_SET_MODE, (nan,) * 5
        has_mode = message.base_mode & mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
        mode = float(message.custom_mode) if has_mode else nan
        return CommandCall(number, message.base_mode, mode, *rest, None, sender, now_ns)
    number, one, two = message.command, message.param1, message.param2
    three, four = message.param3, message.param4
    if message.get_msgId() == mavlink.MAVLINK_MSG_ID_COMMAND_LONG:
        x, y, z, frame = message.param5, message.param6, message.param7, None
    else:
        x, y = (nan if value == INT_UNKNOWN else float(value) for value in (message.x, message.y))
        z, frame = message.z, message.frame
    return CommandCall(number, one, two, three, four, x, y, z, frame, sender, now_ns)


ACCEPTED: Final = mavlink.MAV_RESULT_ACCEPTED
LATER: Final = mavlink.MAV_RESULT_TEMPORARILY_REJECTED
DENIED: Final = mavlink.MAV_RESULT_DENIED
UNSUPPORTED: Final = mavlink.MAV_RESULT_UNSUPPORTED
FAILED: Final = mavlink.MAV_RESULT_FAILED
UNSUPPORTED_FRAME: Final = 9
"""MAV_RESULT_COMMAND_UNSUPPORTED_MAV_FRAME."""

RESULTS: Final = MappingProxyType(
    {
        Reason.NONE: ACCEPTED,
        Reason.NOT_ARMED: FAILED,
        Reason.NO_SENSES: LATER,
        Reason.EMERGENCY_STOPPED: FAILED,
        Reason.GOAL_OUT_OF_RANGE: DENIED,
        Reason.TOLERANCE_OUT_OF_RANGE: DENIED,
        Reason.UNKNOWN_MODE: DENIED,
        Reason.UNKNOWN_NAVIGATOR: DENIED,
        Reason.UNKNOWN_COMMAND: UNSUPPORTED,
        Reason.UNKNOWN_PARAMETER: DENIED,
        Reason.PARAMETER_OUT_OF_RANGE: DENIED,
        Reason.NO_GOAL: FAILED,
        Reason.NO_TRAIL: FAILED,
        Reason.NO_OPERATOR: LATER,
        Reason.DRIVING: LATER,
        Reason.NOT_SAVED: FAILED,
        Reason.MALFORMED: DENIED,
        Reason.LEASE_HELD: RESULT_NOT_IN_CONTROL,
        Reason.OUTSIDE_FENCE: DENIED,
        Reason.NO_MISSION: FAILED,
        Reason.MISSION_EMPTY: DENIED,
        Reason.MISSION_ITEM_BAD: DENIED,
        Reason.MISSION_TOO_LONG: DENIED,
        Reason.HOLD_OUT_OF_RANGE: DENIED,
        Reason.UNKNOWN_FRAME: DENIED,
        Reason.FENCE_NOT_SIMPLE: DENIED,
        Reason.FENCE_LEAVES_ROBOT_OUT: DENIED,
        Reason.TOO_MANY_REQUESTS: LATER,
        Reason.ID_REUSED: LATER,
        Reason.TOO_LATE: LATER,
        Reason.TICKS_LOST: LATER,
        Reason.SCAN_LOST: LATER,
        Reason.SONAR_FROZEN: FAILED,
        Reason.SONAR_IMPOSSIBLE: FAILED,
        Reason.ENCODER_IMPOSSIBLE: FAILED,
        Reason.WHEEL_STUCK: FAILED,
        Reason.NOT_FINITE: FAILED,
        Reason.BUMPER: FAILED,
        Reason.OPERATOR_LOST: LATER,
        Reason.BUDGET: LATER,
        Reason.CORE_EXCEPTION: FAILED,
        Reason.FENCE_BREACHED: FAILED,
        Reason.NAME_TAKEN: FAILED,
        Reason.FENCE_UNCHECKED: FAILED,
        Reason.BLOCKED: FAILED,
        Reason.NO_PROGRESS: FAILED,
        Reason.UNREACHABLE: FAILED,
        Reason.BY_OPERATOR: FAILED,
        Reason.REPLACED: FAILED,
        Reason.DISARMED: FAILED,
        Reason.SHUT_DOWN: FAILED,
        Reason.BY_EMERGENCY_STOP: FAILED,
        Reason.LOST: FAILED,
        Reason.BY_HAND: FAILED,
        Reason.NAVIGATOR_FAILED: FAILED,
        Reason.OBSTACLE_AHEAD: FAILED,
        Reason.SLOWED: FAILED,
        Reason.WHEEL_LIMIT: FAILED,
        Reason.FENCE_UNREADABLE: FAILED,
        Reason.NOT_WHILE_ARMED: LATER,
        Reason.LESS_SAFE_THAN_CONFIGURED: DENIED,
        Reason.NO_IDENTITY: RESULT_NOT_IN_CONTROL,
        Reason.PLACE_UNKNOWN: FAILED,
        Reason.ARMED: DENIED,
        Reason.PARAMETERS_DAMAGED: FAILED,
        Reason.NEWER_STOP: LATER,
        Reason.ALREADY_OVER: FAILED,
        Reason.NOTHING_TO_ABORT: FAILED,
        Reason.NOTHING_LATCHED: ACCEPTED,
        Reason.NO_LEASE: ACCEPTED,
        Reason.NOTHING_KEPT: ACCEPTED,
        Reason.NOTHING_CHANGED: ACCEPTED,
    }
)


def result_of(answered: Answered) -> int:
    """Return the MAV_RESULT for the end of a request; FAILED if the robot did not answer."""
    if answered.ok:
        return int(ACCEPTED)
    if answered.error in (NO_TELEMETRY, KEEPS_FENCE, OVERTAKEN):
        return int(LATER)
    if answered.error in (WATCHER, NEWCOMER) or isinstance(answered.outcome, ParameterChanged):
        return int(DENIED)
    reason = reason_of(answered.outcome)
    return int(FAILED if reason is None else RESULTS[reason])


def reason_of(outcome: Outcome | None) -> Reason | None:
    """Return the reason of a refusal.

    None if it has no reason, or one that this version does not define.
    """
    number = getattr(outcome, "reason", None)
    return Reason(number) if isinstance(number, int) and number in RESULTS else None


COPY_NS: Final = 200 * NS_PER_MS
"""Age up to which a copy by the network arrives. No client repeats a command so early."""
MAX_FRAMES: Final = 256
SAME_NS: Final = 3 * NS_PER_S
"""Age up to which the same frame is recognised by its sequence number, which wraps."""
CONFIRMED_NS: Final = 10 * NS_PER_S
"""Age of a command that is repeated with a `confirmation`."""
UNMARKED_NS: Final = 3 * NS_PER_S // 2
"""Age of a command that is repeated unchanged; MAVSDK repeats it up to 1.5 s later."""
MAX_KEPT: Final = 16
MAX_SENDERS: Final = 256
MAX_OF_CLIENT: Final = 8

Key = tuple[int, int, int]


UNDER_WAY: Final = (
    *(GoalState.NONE, GoalState.ACCEPTED, GoalState.DRIVING),
    *(GoalState.AVOIDING, GoalState.ALIGNING, GoalState.REACHED),
)
"""States of a goal that was not ended by somebody or something else."""


class EndingMark(NamedTuple):
    """Counters of what may end the effect of a command."""

    asked: int
    """Operations of all clients, and changes of control."""
    ended: int
    """Goals that were given up or aborted."""
    stopped: int
    """Stops of all operators."""


class Endings:
    """Counts what ends the effect of commands; `pressed` are the stops of clients."""

    def __init__(self, vehicle: MavVehicle) -> None:
        self._vehicle = vehicle
        self._goal = self._stop_id = self.pressed = self._ended = self._stopped = 0
        self._is_armed = self._holds = False

    @property
    def mark(self) -> EndingMark:
        """The counters now."""
        asked = self._vehicle.control.serial
        return EndingMark(asked, self._ended, self._stopped)

    def due(self) -> None:
        """Read the robot's status."""
        status = self._vehicle.snapshot.status
        if status is None:
            return
        is_armed = status.vehicle == VehicleState.ACTIVE
        holds = self._vehicle.modes.mode is Mode.HOLD
        is_new_stop = status.stop_id not in (0, self._stop_id)
        self._stopped += is_new_stop or self._is_armed > is_armed or self._holds < holds
        goal = 0 if status.goal in UNDER_WAY else status.goal_id
        self._ended += goal not in (0, self._goal)
        self._is_armed, self._holds, self._stop_id, self._goal = (
            *(is_armed, holds, status.stop_id, goal),
        )


@dataclass(slots=True, eq=False)
class Kept:
    """A command that was accepted for execution; `result` is None until it is known.

    `pressed` counts the stops of clients before it, `mark` is of the time of its answer.
    `outlasts`: what it makes is not ended by a stop.
    """

    number: int
    content: bytes
    sequence: int
    at_ns: int
    pressed: int
    outlasts: bool
    result: int | None = None
    mark: EndingMark | None = None


class RepeatAction(Enum):
    """What to do with a command."""

    EXECUTE = auto()
    IGNORE = auto()
    ANSWER = auto()
    """Give the earlier answer again."""
    REFUSE = auto()
    """A stop has ended the effect of the command that this one repeats."""


class Repeats:
    """The newest commands of each sender."""

    def __init__(self, endings: Endings) -> None:
        self._endings = endings
        self._of: OrderedDict[Key, list[Kept]] = OrderedDict()

    def judge(
        self, call: CommandCall, confirmation: int, sequence: int
    ) -> tuple[RepeatAction, int]:
        """Return what to do with a command, and the earlier answer."""
        kept = self._of.get(key_of(call.sender), [])
        latest = True
        for one in reversed(kept):
            is_same = one.number == call.number and one.content == call.content
            age_ns = call.now_ns - one.at_ns
            is_frame = sequence == one.sequence and age_ns < SAME_NS
            is_again = latest and age_ns < (CONFIRMED_NS if confirmation else UNMARKED_NS)
            if is_same and (one.result is None or is_frame or is_again):
                action = self._judged(one, is_frame=is_frame, is_marked=confirmation > 0)
                return action, one.result or 0
            latest = False
        return RepeatAction.EXECUTE, 0

    def _judged(self, one: Kept, *, is_frame: bool, is_marked: bool) -> RepeatAction:
        """Return what to do with a repetition."""
        if one.result is None:
            return RepeatAction.IGNORE
        if one.result != mavlink.MAV_RESULT_ACCEPTED:  # the reason may be gone
            return RepeatAction.ANSWER if is_frame or is_marked else RepeatAction.EXECUTE
        mark, then = self._endings.mark, one.mark or self._endings.mark
        is_stopped = (mark.stopped, self._endings.pressed) != (then.stopped, one.pressed)
        is_over = mark.asked != then.asked
        if not one.outlasts:
            is_over = is_over or is_stopped or mark.ended != then.ended
        if not is_over:
            return RepeatAction.ANSWER
        if is_frame:
            return RepeatAction.IGNORE
        return (
            RepeatAction.REFUSE
            if is_marked and is_stopped and not one.outlasts
            else RepeatAction.EXECUTE
        )

    def keep(self, call: CommandCall, sequence: int, *, outlasts: bool) -> Kept:
        """Keep a new command, and drop the oldest ones beyond the limits."""
        key = key_of(call.sender)
        if key not in self._of:
            self._make_room(key)
        kept = self._of.setdefault(key, [])
        self._of.move_to_end(key)
        pressed = self._endings.pressed
        one = Kept(call.number, call.content, sequence, call.now_ns, pressed, outlasts)
        kept.append(one)
        del kept[:-MAX_KEPT]
        return one

    def answered(self, one: Kept, result: int) -> None:
        """Note the answer to a command."""
        one.result, one.mark = result, self._endings.mark

    def _make_room(self, key: Key) -> None:
        """Drop the oldest sender of the client, or of all: none pushes out those of the others."""
        own = [other for other in self._of if other[0] == key[0]]
        if len(own) >= MAX_OF_CLIENT:
            del self._of[own[0]]
        elif len(self._of) >= MAX_SENDERS:
            self._of.popitem(last=False)

    def forget(self, client: int) -> None:
        """Drop the commands of a client that has disconnected."""
        for key in [key for key in self._of if key[0] == client]:
            del self._of[key]


class Copies:
    """Recognises copies of the newest commands of all senders, made by the network."""

    def __init__(self) -> None:
        self._frames: OrderedDict[tuple[Key, int, int, bytes], int] = OrderedDict()

    def has(self, call: CommandCall, sequence: int) -> bool:
        """Return whether this frame is a copy; keep it."""
        frame = key_of(call.sender), sequence, call.number, call.content
        before_ns = self._frames.pop(frame, None)
        self._frames[frame] = call.now_ns
        if len(self._frames) > MAX_FRAMES:
            self._frames.popitem(last=False)
        return before_ns is not None and call.now_ns - before_ns < COPY_NS


def key_of(sender: Sender) -> Key:
    """Return the key that distinguishes senders."""
    return sender.client, sender.system, sender.component


MAX_WAITING: Final = 8
"""Commands of one client that wait for the robot's answer, under whatever system ids."""
MAX_STOPS: Final = 16
"""The same for one more command that only stops the robot."""
BUSY: Final = "too many commands wait for the robot: send it again"
UNDONE: Final = "the robot was stopped since: to go on, send it as a new command"


class CommandAnswer(NamedTuple):
    """A MAV_RESULT; `words` give the reason of a refusal, or why nothing has changed."""

    result: int
    words: str = ""
    severity: Severity = Severity.WARNING


def answer_to(answered: Answered) -> CommandAnswer:
    """Return the answer to a command by the end of its operation."""
    note = getattr(answered.outcome, "note", 0)
    if note:
        return CommandAnswer(result_of(answered), reason_text(note), Severity.INFO)
    return CommandAnswer(result_of(answered), "" if answered.ok else answered.text)


Handled = CommandAnswer | Awaitable[CommandAnswer | Answered]
"""The answer to a command, or work that waits for the robot and returns it or its operation's end.
"""
Handler = Callable[[CommandCall], Handled | None]
"""Handles a command; None if it is not acknowledged."""


class CommandRow(NamedTuple):
    """How to execute one command.

    `reads`: it changes nothing, so each repetition is answered again, for all clients. `stops`
    returns whether a call only stops the robot: then each repetition is executed. `repeats`: so is
    each repetition of another call. `outlasts`: what it makes is not ended by a stop.
    `is_unlimited`: any number of such calls may wait, because they pass all others.
    """

    handler: Handler
    reads: bool = False
    stops: Callable[[CommandCall], bool] = lambda _: False
    repeats: bool = False
    outlasts: bool = False
    is_unlimited: bool = False


CommandTable = Mapping[int, CommandRow]


class ReceivedCommand(NamedTuple):
    """A command that is executed; `kept` unless it only reads.

    `acknowledged` is the number in its answer, None for a copy of a stop.
    """

    call: CommandCall
    acknowledged: int | None
    kept: Kept | None = None
    is_limited: bool = False


class CommandService(MavService):
    """COMMAND_LONG, COMMAND_INT and SET_MODE; the commands are the rows of all tables."""

    handles = (
        mavlink.MAVLINK_MSG_ID_SET_MODE,
        mavlink.MAVLINK_MSG_ID_COMMAND_INT,
        mavlink.MAVLINK_MSG_ID_COMMAND_LONG,
    )

    def __init__(self, vehicle: MavVehicle, *tables: CommandTable) -> None:
        self._vehicle = vehicle
        self._rows = {number: row for table in tables for number, row in table.items()}
        self._endings = Endings(vehicle)
        self._repeats = Repeats(self._endings)
        self._copies = Copies()
        self._waiting = Counter[int]()

    def receive(self, message: MavMessage, sender: Sender, now_ns: int) -> None:
        """Execute a command, or repeat the answer to it."""
        call = call_of(message, sender, now_ns)
        is_set_mode = message.get_msgId() == mavlink.MAVLINK_MSG_ID_SET_MODE
        acknowledged: int | None
        acknowledged = mavlink.MAVLINK_MSG_ID_SET_MODE if is_set_mode else call.number
        row = self._rows.get(call.number)
        if self._copies.has(call, message.get_seq()):
            acknowledged = None
        if acknowledged is None and not (row and row.stops(call)):
            return
        if row is None:
            self._answer(call, acknowledged, UNSUPPORTED, f"no command {call.number}")
        elif not (row.reads or sender.may_command):
            self._answer(call, acknowledged, DENIED, sender.barred)
        elif row.reads:
            self._vehicle.start(self._execute(row, ReceivedCommand(call, acknowledged)))
        elif (received := self._admit(row, call, acknowledged, message)) is not None:
            self._vehicle.start(self._execute(row, received))

    def due(self, now_ns: int) -> None:
        """Follow what ends the effect of commands."""
        self._endings.due()

    def forget(self, client: int) -> None:
        """Drop the commands kept for a client."""
        self._repeats.forget(client)

    def _admit(
        self, row: CommandRow, call: CommandCall, acknowledged: int | None, message: MavMessage
    ) -> ReceivedCommand | None:
        """Keep a command that is to be executed; answer another one, if it needs an answer."""
        confirmation, sequence = getattr(message, "confirmation", 0), message.get_seq()
        client, stops = call.sender.client, row.stops(call)
        if not (stops or row.repeats):
            action, result = self._repeats.judge(call, confirmation, sequence)
            if action is RepeatAction.ANSWER:
                self._answer(call, acknowledged, result)
            elif action is RepeatAction.REFUSE:
                self._answer(call, acknowledged, LATER, UNDONE)
            if action is not RepeatAction.EXECUTE:
                return None
        is_limited = not (stops and row.is_unlimited)
        if is_limited and self._waiting[client] >= (MAX_STOPS if stops else MAX_WAITING):
            self._answer(call, acknowledged, LATER, BUSY)
            return None
        self._endings.pressed += stops
        kept = self._repeats.keep(call, sequence, outlasts=row.outlasts)
        self._waiting[client] += is_limited
        return ReceivedCommand(call, acknowledged, kept, is_limited)

    async def _execute(self, row: CommandRow, received: ReceivedCommand) -> None:
        """Carry out a command, and acknowledge its end."""
        handled = row.handler(received.call)
        if handled is None:
            return
        ended = handled if isinstance(handled, CommandAnswer) else await handled
        answer = answer_to(ended) if isinstance(ended, Answered) else ended
        client = received.call.sender.client
        if received.kept is not None:
            self._repeats.answered(received.kept, answer.result)
            self._waiting[client] -= received.is_limited
            if not self._waiting[client]:
                del self._waiting[client]
        self._answer(received.call, received.acknowledged, *answer)

    def _answer(
        self,
        call: CommandCall,
        acknowledged: int | None,
        result: int,
        words: str = "",
        severity: Severity = Severity.WARNING,
    ) -> None:
        sender, vehicle = call.sender, self._vehicle
        if words and (result != ACCEPTED or severity is Severity.INFO):
            vehicle.refusals.say(words, sender.client, vehicle.snapshot.now_ns, severity)
        if acknowledged is None:
            return
        ack = mavlink.MAVLink_command_ack_message(
            acknowledged, result, 0, 0, sender.system, sender.component
        )
        # Once, also on a lossy line: a client takes a copy for the answer to its next command.
        vehicle.outbox.send(ack, sender.client)
