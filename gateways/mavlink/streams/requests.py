"""Requests for single messages and for their intervals, by command or by AUTOPILOT_VERSION_REQUEST.

ArduPilot answers an interval of a message that it does not know with FAILED.
"""

from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType
from typing import Final

from gateways.mavlink import ardupilot
from gateways.mavlink.commands.call import Call, whole
from gateways.mavlink.commands.results import ACCEPTED, DENIED, FAILED, LATER, UNSUPPORTED
from gateways.mavlink.commands.service import CommandTable, Reply, Row
from gateways.mavlink.dialect import AvailableModes, CurrentMode, MavMessage, mavlink
from gateways.mavlink.streams.scheduler import MAX_INTERVAL_US, NOT_SENT_US, StreamScheduler
from gateways.mavlink.traffic import Sender
from gateways.mavlink.vehicle import Vehicle

Indexed = Callable[[int, Sender, int], Sequence[MavMessage]]
MAX_NUMBER: Final = 0xFF_FFFF
INTERVAL: Final = mavlink.MAVLINK_MSG_ID_MESSAGE_INTERVAL
MAX_INTERVAL_NUMBER: Final = 0xFFFF
MODE_US: Final = 2_000_000
"""Interval of CURRENT_MODE for clients that request the list of modes. It is not sent to others:
pymavlink counts each message that is missing in its dialect as lost."""


class MessageRequests:
    """Sends a message once to the client that asks for it, and sets intervals."""

    handles = (mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION_REQUEST,)

    def __init__(self, vehicle: Vehicle, scheduler: StreamScheduler) -> None:
        self._vehicle = vehicle
        self._scheduler = scheduler
        self._indexed: Mapping[int, Indexed] = MappingProxyType(
            {AvailableModes.id: self._modes, INTERVAL: self._interval}
        )

    @property
    def table(self) -> CommandTable:
        """The commands by their numbers."""
        return MappingProxyType(
            {
                mavlink.MAV_CMD_REQUEST_MESSAGE: Row(self._request_message, reads=True),
                mavlink.MAV_CMD_SET_MESSAGE_INTERVAL: Row(self._set_interval, reads=True),
                mavlink.MAV_CMD_GET_MESSAGE_INTERVAL: Row(self._get_interval, reads=True),
                mavlink.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES: Row(self._version, reads=True),
            }
        )

    def receive(self, message: MavMessage, sender: Sender, now_ns: int) -> None:
        """Answer AUTOPILOT_VERSION_REQUEST."""
        self.request(mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION, 0, sender, now_ns)

    def due(self, now_ns: int) -> None:
        """Do nothing: no state of this service depends on time."""

    def forget(self, client: int) -> None:
        """Keep nothing for a client."""

    def knows(self, number: int) -> bool:
        """Return whether the vehicle can send a message at all."""
        return number in self._indexed or self._vehicle.catalogue.find(number) is not None

    def request(self, number: int, index: int, sender: Sender, now_ns: int) -> bool:
        """Send a message to a client. False if it is unknown, or its values are missing now."""
        indexed, source = self._indexed.get(number), self._vehicle.catalogue.find(number)
        messages: Sequence[MavMessage] = ()
        if indexed is not None:
            messages = indexed(index, sender, now_ns)
        elif source is not None:
            messages = source.build(now_ns)
        for message in messages:
            self._vehicle.answer(message, sender.client)
        return bool(messages)

    def _request_message(self, call: Call, reply: Reply) -> None:
        number, index = whole(call.param1), whole(call.param2)
        if number is None or not 0 <= number <= MAX_NUMBER:
            reply.result(DENIED, "parameter 1 must be the id of a message")
        elif not self.knows(number):
            reply.result(UNSUPPORTED, f"no message {number}")
        elif self.request(number, index or 0, call.sender, call.now_ns):
            reply.result(ACCEPTED)
        elif number in self._indexed:
            reply.result(DENIED, f"message {number} has no index {call.param2:g}")
        else:
            self._request_later(number, call, reply)

    def _request_later(self, number: int, call: Call, reply: Reply) -> None:
        """Answer when the robot has sent the values: QGroundControl does not ask a second time."""
        source = self._vehicle.catalogue.find(number)

        def then() -> None:
            now_ns = self._vehicle.snapshot.now_ns
            if self.request(number, 0, call.sender, now_ns):
                reply.result(ACCEPTED)
            else:
                reply.result(LATER, f"message {number}: the robot does not send its values now")

        if source is None or source.prepare is None:
            then()
        else:
            source.prepare(then, call.now_ns)

    def _set_interval(self, call: Call, reply: Reply) -> None:
        number, interval_us = whole(call.param1), whole(call.param2)
        if number is None or interval_us is None or interval_us < -1:
            reply.result(DENIED, "parameter 1 must be the id of a message, 2 its interval in us")
            return
        interval_us = min(interval_us, MAX_INTERVAL_US)
        is_set = self._scheduler.set_interval(call.sender.client, number, interval_us, call.now_ns)
        reply.result(ACCEPTED if is_set else FAILED, "" if is_set else f"no stream {number}")

    def _get_interval(self, call: Call, reply: Reply) -> None:
        number = whole(call.param1)
        if number is None or not 0 <= number <= MAX_INTERVAL_NUMBER:
            reply.result(DENIED, "parameter 1 must be the id of a message")
            return
        self.request(INTERVAL, number, call.sender, call.now_ns)
        is_known = self._vehicle.catalogue.find(number) is not None
        reply.result(ACCEPTED if is_known else FAILED, "" if is_known else f"no stream {number}")

    def _version(self, call: Call, reply: Reply) -> None:
        if call.param1 == 1.0:
            self.request(mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION, 0, call.sender, call.now_ns)
            reply.result(ACCEPTED)
        else:
            reply.result(DENIED, "parameter 1 must be 1")

    def _modes(self, index: int, sender: Sender, now_ns: int) -> Sequence[MavMessage]:
        period_us = self._scheduler.interval_us(sender.client, CurrentMode.id, now_ns)
        if period_us == NOT_SENT_US:
            self._scheduler.set_interval(sender.client, CurrentMode.id, MODE_US, now_ns)
        return ardupilot.available_modes(index)

    def _interval(self, number: int, sender: Sender, now_ns: int) -> Sequence[MavMessage]:
        if not 0 <= number <= MAX_INTERVAL_NUMBER:
            return ()
        interval_us = self._scheduler.interval_us(sender.client, number, now_ns)
        return (mavlink.MAVLink_message_interval_message(number, interval_us),)
