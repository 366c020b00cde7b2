"""The operator control protocol: CONTROL_STATUS, and MAV_CMD_REQUEST_OPERATOR_CONTROL.

As in mavlink/mavlink of July 2026: parameter 1 requests (1) or releases (0), parameter 2 permits
takeover without asking, parameter 3 is the time for the owner's answer in seconds, parameter 4 the
system id of the client that wants control. If the owner does not permit takeover, the gateway sends
the same command to the owner. An operator on Sidestep's own bus is reported with the vehicle's own
system id.

CONTROL_STATUS is sent only to a client that has sent the command or has asked for the message: all
others have it in no dialect, or in an older layout, and count each one as a lost frame.
"""

from collections.abc import Sequence
from math import isfinite
from types import MappingProxyType
from typing import Final, NamedTuple, Protocol

from gateways.mavlink.commands.command_protocol import (
    ACCEPTED,
    DENIED,
    FAILED,
    CommandAnswer,
    CommandCall,
    CommandRow,
    CommandTable,
    Handled,
    whole,
)
from gateways.mavlink.mav_service import MavService, Sender
from gateways.mavlink.mav_vehicle import MavVehicle, MessageSource
from gateways.mavlink.mavlink_dialect import (
    CONTROL_SYSTEM_MANAGER,
    CONTROL_TAKEOVER_ALLOWED,
    REQUEST_OPERATOR_CONTROL,
    ControlStatus,
    MavMessage,
    mavlink,
)
from gateways.mavlink.operator_control import Owner
from protocol.wire.enums import Severity
from runtime.units import NS_PER_S

MIN_ANSWER_S: Final = 3.0
MAX_ANSWER_S: Final = 60.0
ANSWER_S: Final = 10.0
"""The time for the owner's answer, if the client gives none."""
NO_SECONDARY: Final = (0,) * 10
STATUS_US: Final = 1_000_000
"""Interval of CONTROL_STATUS."""


class Asked(NamedTuple):
    """A request that was sent to the owner and waits for its answer."""

    requester: Sender
    owner: Owner
    until_ns: int


class Scheduler(Protocol):
    """Sends the messages that are due to each client."""

    def hurry(self, number: int, now_ns: int) -> None:
        """Send a message now to all clients that it is sent to at all."""

    def begin(self, client: int, number: int, interval_us: int, now_ns: int) -> None:
        """Begin to send a message to a client, unless it is sent already."""


class OperatorCommands(MavService):
    """Requests and releases control for clients, and reports the owner to them."""

    def __init__(self, vehicle: MavVehicle, scheduler: Scheduler) -> None:
        self._vehicle = vehicle
        self._scheduler = scheduler
        self._shown = self._state()
        self._asked: Asked | None = None
        vehicle.catalogue.add(MessageSource(ControlStatus.id, self._build))

    @property
    def table(self) -> CommandTable:
        """The command by its number; each repetition is a separate request."""
        row = CommandRow(self._change, repeats=True)
        return MappingProxyType({REQUEST_OPERATOR_CONTROL: row})

    def due(self, now_ns: int) -> None:
        """Send the status at once if it has changed, to the clients that receive it."""
        if self._asked is not None and now_ns >= self._asked.until_ns:
            self._asked = None
        if self._state() != self._shown:
            self._shown = self._state()
            self._scheduler.hurry(ControlStatus.id, now_ns)

    def forget(self, client: int) -> None:
        """Drop the request of a client that has disconnected."""
        if self._asked is not None and self._asked.requester.client == client:
            self._asked = None

    def _state(self) -> tuple[int, int]:
        """Return the flags, and the system id in control."""
        control = self._vehicle.control
        flags = CONTROL_SYSTEM_MANAGER
        flags |= CONTROL_TAKEOVER_ALLOWED if control.takeover_allowed else 0
        if control.owner is not None:
            return flags, control.owner.system
        return flags, self._vehicle.system if control.is_foreign else 0

    def _build(self, now_ns: int) -> Sequence[MavMessage]:
        flags, main = self._state()
        return (ControlStatus(flags, main, list(NO_SECONDARY)),)

    def _change(self, call: CommandCall) -> Handled:
        client, now_ns = call.sender.client, call.now_ns
        self._scheduler.begin(client, ControlStatus.id, STATUS_US, now_ns)
        action, requester = whole(call.param1), whole(call.param4)
        if requester not in (0, call.sender.system):
            return CommandAnswer(DENIED, "parameter 4 must be the system id of the sender")
        if action == 0:
            return self._vehicle.control.release(call.sender)
        if action == 1 and call.param2 in (0.0, 1.0):
            return self._request(call)
        words = "parameter 1 must be 0 to release or 1 to request, parameter 2 0 or 1"
        return CommandAnswer(DENIED, words)

    async def _request(self, call: CommandCall) -> CommandAnswer:
        control, owner = self._vehicle.control, self._vehicle.control.owner
        answered = await control.request(call.sender, allow_takeover=call.param2 == 1.0)
        if answered.ok:
            return CommandAnswer(ACCEPTED)
        if owner is None or control.owner != owner or owner.system == call.sender.system:
            return CommandAnswer(FAILED, answered.text)
        self._ask(owner, call)
        words = f"MAVLink {owner.system} has control and is asked to permit it"
        return CommandAnswer(FAILED, words, Severity.INFO)

    def _ask(self, owner: Owner, call: CommandCall) -> None:
        """Send the request on to the owner, once within the time for the answer."""
        asked = self._asked
        if asked is not None and (asked.requester, asked.owner) == (call.sender, owner):
            return
        given_s = call.param3 if isfinite(call.param3) and call.param3 > 0 else ANSWER_S
        seconds = min(max(given_s, MIN_ANSWER_S), MAX_ANSWER_S)
        self._asked = Asked(call.sender, owner, call.now_ns + round(seconds * NS_PER_S))
        request = mavlink.MAVLink_command_long_message(
            owner.system, 0, REQUEST_OPERATOR_CONTROL, 0,
            1.0, call.param2, seconds, float(call.sender.system), 0.0, 0.0, 0.0,
        )  # fmt: skip
        self._vehicle.outbox.send(request, owner.client)
