"""The command protocol: execute each command once, and acknowledge it to its sender."""

from collections import Counter
from collections.abc import Callable, Mapping
from typing import Final, NamedTuple

from gateways.mavlink.commands.call import Call, call_of
from gateways.mavlink.commands.repeats import Action, Endings, Repeats
from gateways.mavlink.commands.results import ACCEPTED, DENIED, LATER, UNSUPPORTED, result_of
from gateways.mavlink.dialect import MavMessage, mavlink
from gateways.mavlink.port import Answered
from gateways.mavlink.traffic import Sender
from gateways.mavlink.vehicle import Vehicle
from protocol.wire.enums import Severity

MAX_WAITING: Final = 8
"""Commands of one client that wait for the robot's answer, under whatever system ids."""
MAX_STOPS: Final = 16
"""The same for one more command that only stops the robot."""
BUSY: Final = "too many commands wait for the robot: send it again"
UNDONE: Final = "the robot was stopped since: to go on, send it as a new command"


class Reply:
    """The answer to one command, given once: by `result`, or by `ended` as its operation ends."""

    def __init__(self, send: Callable[[int, str, Severity], None]) -> None:
        self._send = send
        self._is_given = False

    def result(self, result: int, words: str = "", severity: Severity = Severity.WARNING) -> None:
        """Acknowledge with a MAV_RESULT; `words` give the reason of a refusal."""
        if not self._is_given:
            self._is_given = True
            self._send(result, words, severity)

    def ended(self, answered: Answered) -> None:
        """Acknowledge with the end of an operation."""
        self.result(result_of(answered), "" if answered.ok else answered.text)


Handler = Callable[[Call, Reply], None]


class Row(NamedTuple):
    """How to execute one command.

    `reads`: it changes nothing, so each repetition is answered again, for all clients. `stops`
    returns whether a call only stops the robot: then each repetition is executed. `repeats`: so is
    each repetition of another call. `outlasts`: what it makes is not ended by a stop.
    `is_unlimited`: any number of such calls may wait, because they pass all others.
    """

    handler: Handler
    reads: bool = False
    stops: Callable[[Call], bool] = lambda _: False
    repeats: bool = False
    outlasts: bool = False
    is_unlimited: bool = False


CommandTable = Mapping[int, Row]


class CommandService:
    """COMMAND_LONG, COMMAND_INT and SET_MODE; the commands are the rows of all tables."""

    handles = (
        mavlink.MAVLINK_MSG_ID_SET_MODE,
        mavlink.MAVLINK_MSG_ID_COMMAND_INT,
        mavlink.MAVLINK_MSG_ID_COMMAND_LONG,
    )

    def __init__(self, vehicle: Vehicle, *tables: CommandTable) -> None:
        self._vehicle = vehicle
        self._rows = {number: row for table in tables for number, row in table.items()}
        self._endings = Endings(vehicle)
        self._repeats = Repeats(self._endings)
        self._waiting = Counter[int]()

    def receive(self, message: MavMessage, sender: Sender, now_ns: int) -> None:
        """Execute a command, or repeat the answer to it."""
        call = call_of(message, sender, now_ns)
        is_set_mode = message.get_msgId() == mavlink.MAVLINK_MSG_ID_SET_MODE
        acknowledged = mavlink.MAVLINK_MSG_ID_SET_MODE if is_set_mode else call.number
        row = self._rows.get(call.number)
        if row is None:
            self._answer(call, acknowledged, UNSUPPORTED, f"no command {call.number}")
        elif not (row.reads or sender.may_command):
            self._answer(call, acknowledged, DENIED, sender.barred)
        elif row.reads:
            row.handler(call, self._reply(call, acknowledged))
        else:
            self._act(row, call, acknowledged, message)

    def due(self, now_ns: int) -> None:
        """Follow what ends the effect of commands."""
        self._endings.due()

    def forget(self, client: int) -> None:
        """Drop the commands kept for a client."""
        self._repeats.forget(client)

    def _act(self, row: Row, call: Call, acknowledged: int, message: MavMessage) -> None:
        confirmation, sequence = getattr(message, "confirmation", 0), message.get_seq()
        client, stops = call.sender.client, row.stops(call)
        if not (stops or row.repeats):
            action, result = self._repeats.judge(call, confirmation, sequence)
            if action is Action.ANSWER:
                self._answer(call, acknowledged, result)
            elif action is Action.REFUSE:
                self._answer(call, acknowledged, LATER, UNDONE)
            if action is not Action.EXECUTE:
                return
        is_limited = not (stops and row.is_unlimited)
        if is_limited and self._waiting[client] >= (MAX_STOPS if stops else MAX_WAITING):
            self._answer(call, acknowledged, LATER, BUSY)
            return
        self._endings.pressed += stops
        kept = self._repeats.keep(call, sequence, outlasts=row.outlasts)
        self._waiting[client] += is_limited

        def send(result: int, words: str, severity: Severity) -> None:
            self._repeats.answered(kept, result)
            self._waiting[client] -= is_limited
            if not self._waiting[client]:
                del self._waiting[client]
            self._answer(call, acknowledged, result, words, severity)

        row.handler(call, Reply(send))

    def _reply(self, call: Call, acknowledged: int) -> Reply:
        return Reply(lambda *answer: self._answer(call, acknowledged, *answer))

    def _answer(
        self,
        call: Call,
        acknowledged: int,
        result: int,
        words: str = "",
        severity: Severity = Severity.WARNING,
    ) -> None:
        sender, vehicle = call.sender, self._vehicle
        if words and result != ACCEPTED:
            vehicle.refusals.say(words, sender.client, vehicle.snapshot.now_ns, severity)
        ack = mavlink.MAVLink_command_ack_message(
            acknowledged, result, 0, 0, sender.system, sender.component
        )
        # MAVSDK has several requests under way, and tells their answers apart by the number alone.
        is_request = call.number in self._rows and self._rows[call.number].reads
        (vehicle.outbox.send if is_request else vehicle.answer)(ack, sender.client)
