"""The PARAM protocol: list, read by name or index, and set (row 19 of the list).

The parameters as last read from the robot are shared with the files and the streams.
"""

from dataclasses import dataclass
from typing import Final, NamedTuple

from gateways.mavlink.mav_service import MavService, Pacing, Sender
from gateways.mavlink.mav_vehicle import MavVehicle, MessageSource
from gateways.mavlink.mavlink_dialect import ComponentMetadata, MavMessage, mavlink
from gateways.mavlink.parameter_table import (
    MAX_TIMEOUT_S,
    MIN_TIMEOUT_S,
    MavTable,
    Metadata,
    Owner,
    component_metadata,
    is_cast,
    metadata_of,
    table_of,
)
from gateways.mavlink.robot_copy import PERIOD_NS, RobotCopy
from gateways.mavlink.robot_port import Answered
from ground.client.parameter import Parameter
from ground.client.parameters import ParameterChanged
from ground.commands.param import ParameterTable, SetParameter, ShowParameters
from runtime.errors import RemoteError
from runtime.units import NS_PER_MS


class ParameterStore(RobotCopy[MavTable]):
    """The list of parameters; its values that have changed are sent to all clients."""

    busy = "too many requests for parameters at once"
    again_ns = PERIOD_NS

    def __init__(self, vehicle: MavVehicle) -> None:
        super().__init__(vehicle, ShowParameters(), self._table_in)
        self._metadata: Metadata | None = None

    @property
    def metadata(self) -> Metadata | None:
        """The files that describe the parameters, None while the parameters are unknown."""
        if self._metadata is None and self.values is not None:
            self._metadata = metadata_of(self.values)
        return self._metadata

    def adopt_value(self, index: int, value: float) -> None:
        """Store the value that the robot has reported for one parameter.

        Send it to all clients.
        """
        if self.values is not None and index < len(self.values):
            table = self.values.with_value(index, value)
            self._use(table)
            self._vehicle.outbox.send(table.message(index))

    def _table_in(self, answered: Answered) -> MavTable | None:
        """Return the table that the robot has sent, None if it has not answered."""
        found = answered.outcome
        if not isinstance(found, ParameterTable):
            return None
        return table_of(found.parameters, self._vehicle.guided_timeout_s)

    def _take(self, values: MavTable) -> None:
        """Keep a table that has been read."""
        older = self.values
        self._use(values)
        for index in [] if older is None else values.changed_since(older):
            self._vehicle.outbox.send(values.message(index))

    def _use(self, table: MavTable) -> None:
        if self.values is None or not table.describes_same(self.values):
            self._metadata = None
        self.values = table
        own = (one.own for one in table.parameters if one.owner is Owner.ROBOT)
        self._vehicle.parameters = {one.name: one.value for one in own}


VALUE_BYTES: Final = 37
PASSES: Final = 4
"""Times that a list is sent on a line without a limit. A client that has lost a value asks for it
after a second or two; the list takes some milliseconds."""
PASS_NS: Final = 100 * NS_PER_MS
"""Time between the beginnings of two passes."""
BY_NAME: Final = -1
MAX_PENDING: Final = 64
"""Maximum number of changes without an answer of the robot."""
NOT_CAST: Final = "send a finite number cast to float"
READ_ONLY: Final = "read-only"
UNKNOWN: Final = "no such parameter"


class PendingChange(NamedTuple):
    """A PARAM_SET whose answer is awaited."""

    client: int
    number: int
    value: float


@dataclass(slots=True)
class Listing:
    """A list that is being sent: the next index, the passes left, and when the next one begins."""

    passes: int
    due_ns: int
    index: int = 0


class ParameterProtocol(MavService):
    """Answers each client. A value that the robot has accepted is sent to all clients."""

    handles = (
        mavlink.MAVLINK_MSG_ID_PARAM_REQUEST_READ,
        mavlink.MAVLINK_MSG_ID_PARAM_REQUEST_LIST,
        mavlink.MAVLINK_MSG_ID_PARAM_SET,
    )

    def __init__(self, vehicle: MavVehicle, store: ParameterStore, pacing: Pacing) -> None:
        self._vehicle = vehicle
        self._store = store
        self._pacing = pacing
        self._refusals = vehicle.refusals
        self._lists: dict[int, Listing] = {}
        self._pending: set[PendingChange] = set()
        self._now_ns = 0
        vehicle.catalogue.add(
            MessageSource(ComponentMetadata.id, self._describe, prepare=store.known)
        )

    def receive(self, message: MavMessage, sender: Sender, now_ns: int) -> None:
        """Start a list, or answer a request for one parameter."""
        self._now_ns = now_ns
        self._vehicle.start(self._answer(message, sender, now_ns))

    def due(self, now_ns: int) -> None:
        """Continue the lists, as fast as the line of each client allows."""
        self._now_ns = now_ns
        self._store.due(now_ns)
        table = self._store.values
        for client, listing in list(self._lists.items()):
            if table is None or self._is_sent(client, listing, table):
                del self._lists[client]

    def forget(self, client: int) -> None:
        """Drop the list and the budget of a client that has disconnected."""
        self._lists.pop(client, None)
        self._pacing.forget(client)

    def _is_sent(self, client: int, listing: Listing, table: MavTable) -> bool:
        """Go on with a list; return whether it has been sent as often as it should."""
        now_ns = self._now_ns
        if now_ns < listing.due_ns:
            return False
        while listing.index < len(table):
            if not self._pacing.take(client, VALUE_BYTES, now_ns):
                return False
            self._vehicle.outbox.send(table.message(listing.index), client)
            listing.index += 1
        listing.passes -= 1
        listing.index, listing.due_ns = 0, listing.due_ns + PASS_NS
        return listing.passes <= 0

    def _describe(self, now_ns: int) -> list[MavMessage]:
        """Return COMPONENT_METADATA if the parameters are known."""
        found = self._store.metadata
        time_ms = self._vehicle.boot_ms(now_ns)
        return [] if found is None else [component_metadata(found, time_ms)]

    async def _answer(self, message: MavMessage, sender: Sender, now_ns: int) -> None:
        number = message.get_msgId()
        is_list = number == mavlink.MAVLINK_MSG_ID_PARAM_REQUEST_LIST
        is_change = number == mavlink.MAVLINK_MSG_ID_PARAM_SET
        read, before = self._store.known if is_change else self._store.latest, self._store.values
        try:
            table = await read(now_ns)
        except RemoteError as error:
            self._say(sender, f"no parameters: {error}")
            return
        if is_list:
            is_slow = self._vehicle.clients.get(sender.client) is not None
            self._lists[sender.client] = Listing(1 if is_slow else PASSES, self._now_ns)
        elif (index := self._index(message, sender, table)) is None:
            return
        elif is_change:
            await self._set(message, sender, table, index)
        elif before is None or index not in table.changed_since(before):  # else all have got it
            self._vehicle.outbox.send(table.message(index), sender.client)

    async def _set(self, message: MavMessage, sender: Sender, table: MavTable, index: int) -> None:
        parameter, value = table.parameters[index], float(message.param_value)
        change = PendingChange(sender.client, index, value)
        if not is_cast(value):
            error = mavlink.MAV_PARAM_ERROR_VALUE_OUT_OF_RANGE
            self._refuse(table, sender, index, NOT_CAST, error)
        elif parameter.is_fixed:
            error = mavlink.MAV_PARAM_ERROR_READ_ONLY
            self._refuse(table, sender, index, READ_ONLY, error)
        elif len(self._pending) >= MAX_PENDING:
            error = mavlink.MAV_PARAM_ERROR_PERMISSION_DENIED
            self._refuse(table, sender, index, "too many changes at once", error)
        elif change not in self._pending:
            self._pending.add(change)
            if parameter.owner is Owner.GATEWAY:
                answer = await self._set_timeout(parameter.own, value, sender)
            else:
                operation = SetParameter(name=parameter.own.name, value=value)
                answer = await self._vehicle.control.perform(sender, operation)
            self._end(answer, sender, change)

    async def _set_timeout(self, own: Parameter, value_s: float, sender: Sender) -> Answered:
        """Change the gateway's own parameter, until it ends."""
        answered = await self._vehicle.control.ensure(sender)
        if not answered.ok:
            return answered
        if not MIN_TIMEOUT_S <= value_s <= MAX_TIMEOUT_S:
            words = f"it must be within {MIN_TIMEOUT_S:g} to {MAX_TIMEOUT_S:g} {own.unit}"
            refused = ParameterChanged(name=own.name, asked=value_s, now=None, refusal=words)
            return Answered(refused)
        self._vehicle.guided_timeout_s = value_s
        changed = ParameterChanged(name=own.name, asked=value_s, now=value_s, saved=False)
        return Answered(changed)

    def _end(self, answer: Answered, sender: Sender, change: PendingChange) -> None:
        """Tell the end of a change: all clients the new value, or its client why there is none."""
        self._pending.discard(change)
        found, table = answer.outcome, self._store.values
        if isinstance(found, ParameterChanged) and found.now is not None:
            self._store.adopt_value(change.number, found.now)
            if not found.ok:
                self._say(sender, found.text)
        elif table is not None and change.number < len(table):
            is_refused = isinstance(found, ParameterChanged)
            why = found.refusal if isinstance(found, ParameterChanged) else answer.text
            out_of_range = mavlink.MAV_PARAM_ERROR_VALUE_OUT_OF_RANGE
            error = out_of_range if is_refused else mavlink.MAV_PARAM_ERROR_PERMISSION_DENIED
            self._refuse(table, sender, change.number, why, error)

    def _refuse(self, table: MavTable, sender: Sender, index: int, why: str, error: int) -> None:
        """Answer with the value in force, and the reason why it is not the requested one."""
        name, outbox = table.parameters[index].name, self._vehicle.outbox
        # Send the error first: without one, MAVSDK repeats a request that had another result.
        outbox.send(param_error(sender, name, index, error), sender.client)
        outbox.send(table.message(index), sender.client)
        self._say(sender, f"{name} not changed: {why}")

    def _index(self, message: MavMessage, sender: Sender, table: MavTable) -> int | None:
        """Return the index of the parameter that a message names; refuse it if there is none."""
        number = getattr(message, "param_index", BY_NAME)
        name = name_of(message.param_id)
        if number != BY_NAME and 0 <= number < len(table):
            return int(number)
        found = table.index(name) if number == BY_NAME else None
        if found is None:
            error = mavlink.MAV_PARAM_ERROR_DOES_NOT_EXIST
            self._vehicle.outbox.send(param_error(sender, name, number, error), sender.client)
            wanted = name if number == BY_NAME else f"index {number}"
            self._say(sender, f"parameter {wanted}: {UNKNOWN}")
        return found

    def _say(self, sender: Sender, words: str) -> None:
        self._refusals.say(words, sender.client, self._now_ns)


def name_of(text: str) -> str:
    """Return the printable part of a name."""
    return "".join(sign for sign in text if sign.isascii() and sign.isprintable())


def param_error(sender: Sender, name: str, index: int, error: int) -> MavMessage:
    """Return PARAM_ERROR for a client."""
    return mavlink.MAVLink_param_error_message(
        sender.system, sender.component, name.encode(), index, error
    )
