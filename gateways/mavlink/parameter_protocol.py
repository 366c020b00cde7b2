"""The PARAM protocol: list, read by name or index, and set (row 19 of the list).

The parameters as last read from the robot are shared with the files and the streams.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, NamedTuple

from gateways.mavlink.mav_service import Pacing, Sender
from gateways.mavlink.mav_vehicle import MavVehicle, MessageSource
from gateways.mavlink.mavlink_dialect import ComponentMetadata, MavMessage, mavlink
from gateways.mavlink.parameter_table import (
    MavTable,
    Metadata,
    component_metadata,
    is_cast,
    metadata_of,
    table_of,
)
from gateways.mavlink.robot_port import Answered
from ground.commands.param import (
    ParameterChanged,
    ParameterTable,
    SetParameter,
    ShowParameters,
)
from runtime.units import NS_PER_MS, NS_PER_S

FRESH_NS: Final = NS_PER_S
PERIOD_NS: Final = 10 * NS_PER_S
"""Changes by other operators are read within this time."""
MAX_WAITING: Final = 64
BUSY: Final = "too many requests for parameters at once"

Then = Callable[[MavTable | None, str], None]
"""Receives the table, or None with the reason."""


class ParameterStore:
    """Reads the list on request, and periodically while there are clients."""

    def __init__(self, vehicle: MavVehicle) -> None:
        self.table: MavTable | None = None
        self._metadata: Metadata | None = None
        self._vehicle = vehicle
        self._waiting: list[Then] = []
        self._is_asking = False
        self._asked_ns = -PERIOD_NS
        self._read_ns = -PERIOD_NS

    @property
    def metadata(self) -> Metadata | None:
        """The files that describe the parameters, None while the parameters are unknown."""
        if self._metadata is None and self.table is not None:
            self._metadata = metadata_of(self.table)
        return self._metadata

    def due(self, now_ns: int) -> None:
        """Read the list if its time has come."""
        vehicle = self._vehicle
        is_time = now_ns - self._asked_ns >= PERIOD_NS
        if is_time and vehicle.clients and vehicle.snapshot.is_live:
            self._ask(now_ns)

    def latest(self, then: Then, now_ns: int) -> None:
        """Call `then` with a table that is at most a second old, perhaps in a later round."""
        if self.table is not None and now_ns - self._read_ns < FRESH_NS:
            then(self.table, "")
        elif len(self._waiting) >= MAX_WAITING:
            then(None, BUSY)
        else:
            self._waiting.append(then)
            self._ask(now_ns)

    def known(self, then: Then, now_ns: int) -> None:
        """Call `then` with the table that was last read; read it if there is none."""
        if self.table is None:
            self.latest(then, now_ns)
        else:
            then(self.table, "")

    def adopt(self, index: int, value: float) -> None:
        """Store the value that the robot has reported for one parameter.

        Send it to all clients.
        """
        if self.table is not None and index < len(self.table):
            self._use(self.table.with_value(index, value))
            self._vehicle.outbox.send(self.table.message(index))
            for client in self._vehicle.lossy:
                self._vehicle.outbox.send(self.table.message(index), client)

    def _ask(self, now_ns: int) -> None:
        if not self._is_asking:
            self._is_asking = True
            self._asked_ns = now_ns
            self._vehicle.port.perform(ShowParameters(), self._read)

    def _read(self, answer: Answered) -> None:
        self._is_asking = False
        waiting, self._waiting = self._waiting, []
        if not isinstance(answer.outcome, ParameterTable):
            for then in waiting:
                then(None, answer.text)
            return
        older, table = self.table, table_of(answer.outcome.parameters)
        self._read_ns = self._asked_ns
        self._use(table)
        for index in [] if older is None else table.changed_since(older):
            self._vehicle.outbox.send(table.message(index))
        for then in waiting:
            then(table, "")

    def _use(self, table: MavTable) -> None:
        if self.table is None or not table.describes_same(self.table):
            self._metadata = None
        self.table = table
        own = (one.own for one in table.parameters if not one.is_fixed)
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


class ParameterProtocol:
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
            MessageSource(ComponentMetadata.id, self._describe, prepare=self._prepare_description)
        )

    def receive(self, message: MavMessage, sender: Sender, now_ns: int) -> None:
        """Start a list, or answer a request for one parameter."""
        self._now_ns = now_ns
        number = message.get_msgId()
        if number == mavlink.MAVLINK_MSG_ID_PARAM_REQUEST_LIST:
            self._store.latest(lambda table, why: self._begin(sender, table, why), now_ns)
        elif number == mavlink.MAVLINK_MSG_ID_PARAM_REQUEST_READ:
            self._store.known(lambda table, why: self._send(message, sender, table, why), now_ns)
        else:
            self._store.known(lambda table, why: self._set(message, sender, table, why), now_ns)

    def due(self, now_ns: int) -> None:
        """Continue the lists, as fast as the line of each client allows."""
        self._now_ns = now_ns
        self._store.due(now_ns)
        table = self._store.table
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

    def _prepare_description(self, then: Callable[[], None], now_ns: int) -> None:
        self._store.known(lambda _table, _why: then(), now_ns)

    def _begin(self, sender: Sender, table: MavTable | None, why: str) -> None:
        if table is None:
            self._say(sender, f"no parameters: {why}")
        else:
            is_slow = self._vehicle.clients.get(sender.client) is not None
            self._lists[sender.client] = Listing(1 if is_slow else PASSES, self._now_ns)

    def _send(self, message: MavMessage, sender: Sender, table: MavTable | None, why: str) -> None:
        index = self._index(message, sender, table, why)
        if table is not None and index is not None:
            self._vehicle.answer(table.message(index), sender.client)

    def _set(self, message: MavMessage, sender: Sender, table: MavTable | None, why: str) -> None:
        index = self._index(message, sender, table, why)
        if table is None or index is None:
            return
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
            operation = SetParameter(name=parameter.own.name, value=value)
            done = self._answered
            self._vehicle.perform(sender, operation, lambda end: done(end, sender, change))

    def _answered(self, answer: Answered, sender: Sender, change: PendingChange) -> None:
        self._pending.discard(change)
        found, table = answer.outcome, self._store.table
        if isinstance(found, ParameterChanged) and found.now is not None:
            self._store.adopt(change.number, found.now)
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

    def _index(
        self, message: MavMessage, sender: Sender, table: MavTable | None, why: str
    ) -> int | None:
        """Return the index of the parameter that a message names; refuse it if there is none."""
        if table is None:
            self._say(sender, f"no parameters: {why}")
            return None
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
