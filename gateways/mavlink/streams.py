"""Streams: default rates, the rates of each client within its line's capacity, single messages.

Clients choose rates by SET_MESSAGE_INTERVAL and REQUEST_DATA_STREAM. ArduPilot answers an interval
of a message that it does not know with FAILED.
"""

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from functools import partial
from types import MappingProxyType
from typing import Final, NamedTuple

from gateways.mavlink import ardupilot, telemetry_messages
from gateways.mavlink.commands.command_protocol import (
    ACCEPTED,
    DENIED,
    FAILED,
    LATER,
    UNSUPPORTED,
    CommandAnswer,
    CommandCall,
    CommandRow,
    CommandTable,
    Handled,
    whole,
)
from gateways.mavlink.mav_service import MAVLINK_1_LAST, MavService, Sender
from gateways.mavlink.mav_vehicle import HEARTBEAT, Catalogue, MavVehicle, MessageSource
from gateways.mavlink.mavlink_dialect import AvailableModes, CurrentMode, MavMessage, mavlink
from runtime.errors import RemoteError
from runtime.units import NS_PER_MS, NS_PER_S, NS_PER_US

ROUND_NS: Final = 50 * NS_PER_MS
"""Shortest time between two messages of a stream: the robot sends telemetry at 20 Hz."""
EARLY_NS: Final = 10 * NS_PER_MS
"""A stream is sent up to this time before it is due, so that jitter does not skip a message."""
PHASE_NS: Final = 20 * NS_PER_MS
MAX_HZ: Final = NS_PER_S / ROUND_NS
STREAMS_SHARE: Final = 0.9
"""The part of a line that streams may use; answers and texts use the rest."""


class ClientStreams:
    """Rates of one client. On a line that is too slow, all are lowered by the same factor."""

    def __init__(self, catalogue: Catalogue, line_bytes_s: int | None, now_ns: int) -> None:
        self._catalogue = catalogue
        self._limit_bytes_s = None if line_bytes_s is None else line_bytes_s * STREAMS_SHARE
        self._defaults_hz = {source.number: source.rate_hz for source in catalogue}
        if self._limit_bytes_s is not None and self._cost(self._defaults_hz) > self._limit_bytes_s:
            self._defaults_hz = {source.number: source.slow_hz for source in catalogue}
        self._wanted_hz = dict(self._defaults_hz)
        self._periods_ns: dict[int, int] = {}
        self._due_ns: dict[int, int] = {}
        self._next_ns = now_ns
        self.shortest_ns = NS_PER_S
        self._plan(now_ns)

    def set(self, number: int, rate_hz: float, now_ns: int) -> None:
        """Change the rate of a message; 0 ends it."""
        self._wanted_hz[number] = min(rate_hz, MAX_HZ)
        self._plan(now_ns)

    def set_group(self, group: int | None, rate_hz: float, now_ns: int) -> None:
        """Change the rate of all messages of a group, or of every group if it is None."""
        for source in self._catalogue:
            if source.group is not None and group in (None, source.group):
                self._wanted_hz[source.number] = min(rate_hz, MAX_HZ)
        self._plan(now_ns)

    def reset(self, number: int, now_ns: int) -> None:
        """Return a message to its default rate."""
        self.set(number, self._defaults_hz.get(number, 0.0), now_ns)

    def period_ns(self, number: int) -> int:
        """Return the time between two messages; 0 if it is not sent."""
        return self._periods_ns.get(number, 0)

    def hurry(self, number: int, now_ns: int) -> None:
        """Make a message due now, if it is sent to the client at all."""
        if number in self._due_ns:
            self._due_ns[number] = self._next_ns = now_ns

    def take(self, now_ns: int) -> list[int]:
        """Return the messages that are due. A missed message is skipped."""
        until_ns = now_ns + EARLY_NS
        if until_ns < self._next_ns:
            return []
        found = []
        for number, due_ns in self._due_ns.items():
            if due_ns <= until_ns:
                found.append(number)
                period_ns = self._periods_ns[number]
                next_ns = due_ns + period_ns
                self._due_ns[number] = next_ns if next_ns > now_ns else now_ns + period_ns
        self._next_ns = min(self._due_ns.values(), default=now_ns + NS_PER_S)
        return found

    def _plan(self, now_ns: int) -> None:
        """Spread the streams over the rounds; those whose period stays keep their phase."""
        factor = 1.0
        if self._limit_bytes_s is not None:
            factor = max(1.0, self._cost(self._wanted_hz) / self._limit_bytes_s)
        running = {number: rate_hz for number, rate_hz in self._wanted_hz.items() if rate_hz > 0}
        for number in set(self._due_ns) - set(running):
            del self._due_ns[number], self._periods_ns[number]
        for place, (number, rate_hz) in enumerate(running.items()):
            period_ns = round(NS_PER_S * factor / rate_hz)
            if self._periods_ns.get(number) != period_ns:
                self._periods_ns[number] = period_ns
                self._due_ns[number] = now_ns + place * PHASE_NS % period_ns
        self._next_ns = now_ns
        self.shortest_ns = min(self._periods_ns.values(), default=NS_PER_S)

    def _cost(self, rates_hz: dict[int, float]) -> float:
        """Return the bytes per second of all streams, at most."""
        found = 0.0
        for number, rate_hz in rates_hz.items():
            source = self._catalogue.find(number)
            found += 0.0 if source is None else rate_hz * source.largest_bytes
        return found


RAW: Final = mavlink.MAV_DATA_STREAM_RAW_SENSORS
STATUS: Final = mavlink.MAV_DATA_STREAM_EXTENDED_STATUS
POSITION: Final = mavlink.MAV_DATA_STREAM_POSITION
EXTRA1: Final = mavlink.MAV_DATA_STREAM_EXTRA1
EXTRA2: Final = mavlink.MAV_DATA_STREAM_EXTRA2
EXTRA3: Final = mavlink.MAV_DATA_STREAM_EXTRA3


class StreamSource(NamedTuple):
    """A source whose builder still needs the vehicle."""

    number: int
    build: Callable[[MavVehicle, int], Sequence[MavMessage]]
    rate_hz: float
    slow_hz: float
    group: int | None = None
    copies: int = 1

    def source(self, vehicle: MavVehicle) -> MessageSource:
        """Return the source of a vehicle."""
        return MessageSource(self.number, partial(self.build, vehicle), *self[2:])


STREAMS: Final = (
    StreamSource(mavlink.MAVLINK_MSG_ID_SYS_STATUS, telemetry_messages.sys_status, 2, 1, STATUS),
    StreamSource(
        mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT,
        telemetry_messages.global_position,
        10,
        4,
        POSITION,
    ),
    StreamSource(
        mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED,
        telemetry_messages.local_position,
        10,
        4,
        POSITION,
    ),
    StreamSource(mavlink.MAVLINK_MSG_ID_ATTITUDE, telemetry_messages.attitude, 10, 4, EXTRA1),
    StreamSource(mavlink.MAVLINK_MSG_ID_VFR_HUD, telemetry_messages.hud, 2, 2, EXTRA2),
    StreamSource(
        mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED_COV, telemetry_messages.local_position_cov, 5, 0
    ),
    StreamSource(mavlink.MAVLINK_MSG_ID_ODOMETRY, telemetry_messages.odometry_message, 5, 1),
    StreamSource(
        mavlink.MAVLINK_MSG_ID_OBSTACLE_DISTANCE, telemetry_messages.obstacle_distance, 5, 4, RAW
    ),
    StreamSource(
        mavlink.MAVLINK_MSG_ID_DISTANCE_SENSOR, telemetry_messages.distance_sensors, 5, 2, EXTRA3, 5
    ),
    StreamSource(mavlink.MAVLINK_MSG_ID_RANGEFINDER, telemetry_messages.rangefinder, 2, 1, EXTRA3),
    StreamSource(mavlink.MAVLINK_MSG_ID_WHEEL_DISTANCE, telemetry_messages.wheel_distance, 0, 0),
    StreamSource(mavlink.MAVLINK_MSG_ID_GPS_RAW_INT, telemetry_messages.gps_raw, 1, 1, STATUS),
    StreamSource(mavlink.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN, telemetry_messages.gps_origin, 0, 0),
    StreamSource(
        mavlink.MAVLINK_MSG_ID_NAV_CONTROLLER_OUTPUT,
        telemetry_messages.nav_controller,
        1,
        0.5,
        STATUS,
    ),
    StreamSource(
        mavlink.MAVLINK_MSG_ID_POSITION_TARGET_GLOBAL_INT,
        telemetry_messages.position_target,
        1,
        0.5,
        STATUS,
    ),
    StreamSource(mavlink.MAVLINK_MSG_ID_HOME_POSITION, telemetry_messages.home_position, 1, 0.5),
    StreamSource(
        mavlink.MAVLINK_MSG_ID_BATTERY_STATUS, telemetry_messages.battery_status, 1, 0.5, EXTRA3
    ),
    StreamSource(
        mavlink.MAVLINK_MSG_ID_EKF_STATUS_REPORT, telemetry_messages.ekf_status, 1, 1, EXTRA3
    ),
    StreamSource(mavlink.MAVLINK_MSG_ID_SYSTEM_TIME, telemetry_messages.system_time, 1, 1, EXTRA3),
    StreamSource(
        mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE, telemetry_messages.extended_state, 1, 1
    ),
    StreamSource(CurrentMode.id, telemetry_messages.current_mode, 0, 0),
    StreamSource(
        mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION, telemetry_messages.autopilot_version, 0, 0
    ),
)


NOT_SENT_US: Final = -1
HEARTBEAT_US: Final = 1_000_000
MAX_INTERVAL_US: Final = 0x7FFF_FFFF


class StreamScheduler(MavService):
    """Sends the due messages to each client; CURRENT_MODE also after a change of the mode."""

    handles = (mavlink.MAVLINK_MSG_ID_REQUEST_DATA_STREAM,)

    def __init__(self, vehicle: MavVehicle) -> None:
        self._vehicle = vehicle
        self._clients: dict[int, ClientStreams] = {}
        self._mode = vehicle.modes.number
        for stream in STREAMS:
            vehicle.catalogue.add(stream.source(vehicle))

    def receive(self, message: MavMessage, sender: Sender, now_ns: int) -> None:
        """Set the rate of a group of messages, or of all groups."""
        rate_hz = message.req_message_rate if message.start_stop == 1 else 0
        every = message.req_stream_id == mavlink.MAV_DATA_STREAM_ALL
        streams = self._streams(sender.client, now_ns)
        if streams is not None:
            streams.set_group(None if every else message.req_stream_id, rate_hz, now_ns)

    def due(self, now_ns: int) -> None:
        """Send the due messages."""
        vehicle = self._vehicle
        mode = vehicle.modes.number
        if mode != self._mode:
            self._mode = mode
            self.hurry(CurrentMode.id, now_ns)
        for client in vehicle.clients:
            known = self._streams(client, now_ns)
            for number in () if known is None else known.take(now_ns):
                for message in vehicle.catalogue.build(number, now_ns):
                    vehicle.outbox.send(message, client, is_stream=True)
        periods_ns = (streams.shortest_ns for streams in self._clients.values())
        vehicle.shortest_ns = min(periods_ns, default=NS_PER_S)

    def forget(self, client: int) -> None:
        """Drop the rates of a client that has disconnected."""
        self._clients.pop(client, None)

    def hurry(self, number: int, now_ns: int) -> None:
        """Send a message now to all clients that it is sent to at all."""
        for streams in self._clients.values():
            streams.hurry(number, now_ns)

    def begin(self, client: int, number: int, interval_us: int, now_ns: int) -> None:
        """Begin to send a message to a client that knows it, unless it is sent already."""
        if self.interval_us(client, number, now_ns) == NOT_SENT_US:
            self.set_interval(client, number, interval_us, now_ns)

    def set_interval(self, client: int, number: int, interval_us: int, now_ns: int) -> bool:
        """Set the interval of a message: -1 ends it, 0 is the default. False if it is unknown."""
        streams = self._streams(client, now_ns)
        if streams is None or self._vehicle.catalogue.find(number) is None:
            return False
        if number == HEARTBEAT:  # its rate is fixed
            return interval_us in (0, HEARTBEAT_US)
        if interval_us == 0:
            streams.reset(number, now_ns)
        else:
            rate_hz = 0.0 if interval_us < 0 else NS_PER_S / NS_PER_US / interval_us
            streams.set(number, rate_hz, now_ns)
        return True

    def interval_us(self, client: int, number: int, now_ns: int) -> int:
        """Return the interval of a message: -1 if it is not sent, 0 if it is unknown."""
        streams = self._streams(client, now_ns)
        if streams is None or self._vehicle.catalogue.find(number) is None:
            return 0
        if number == HEARTBEAT:
            return HEARTBEAT_US
        period_us = streams.period_ns(number) // NS_PER_US
        return min(period_us, MAX_INTERVAL_US) if period_us else NOT_SENT_US

    def _streams(self, client: int, now_ns: int) -> ClientStreams | None:
        found = self._clients.get(client)
        if found is None and client in self._vehicle.clients:
            line_bytes_s = self._vehicle.clients[client]
            found = ClientStreams(self._vehicle.catalogue, line_bytes_s, now_ns)
            self._clients[client] = found
        return found


Indexed = Callable[[int, Sender, int], Sequence[MavMessage]]
MAX_NUMBER: Final = 0xFF_FFFF
TOO_OLD: Final = "message {}: MAVLink 1 cannot carry it, send a frame of MAVLink 2 first"
INTERVAL: Final = mavlink.MAVLINK_MSG_ID_MESSAGE_INTERVAL
MAX_INTERVAL_NUMBER: Final = 0xFFFF
MODE_US: Final = 2_000_000
"""Interval of CURRENT_MODE for clients that request the list of modes. It is not sent to others:
pymavlink counts each message that is missing in its dialect as lost."""


class MessageRequests(MavService):
    """Sends a message once to the client that asks for it, and sets intervals."""

    handles = (mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION_REQUEST,)

    def __init__(self, vehicle: MavVehicle, scheduler: StreamScheduler) -> None:
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
                mavlink.MAV_CMD_REQUEST_MESSAGE: CommandRow(self._request_message, reads=True),
                mavlink.MAV_CMD_SET_MESSAGE_INTERVAL: CommandRow(self._set_interval, reads=True),
                mavlink.MAV_CMD_GET_MESSAGE_INTERVAL: CommandRow(self._get_interval, reads=True),
                mavlink.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES: CommandRow(
                    self._version, reads=True
                ),
            }
        )

    def receive(self, message: MavMessage, sender: Sender, now_ns: int) -> None:
        """Answer AUTOPILOT_VERSION_REQUEST."""
        self.request(mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION, 0, sender, now_ns)

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

    def _request_message(self, call: CommandCall) -> Handled:
        number, index = whole(call.param1), whole(call.param2)
        if number is None or not 0 <= number <= MAX_NUMBER:
            return CommandAnswer(DENIED, "parameter 1 must be the id of a message")
        if not self.knows(number):
            return CommandAnswer(UNSUPPORTED, f"no message {number}")
        if call.sender.is_mavlink1 and number > MAVLINK_1_LAST:
            return CommandAnswer(UNSUPPORTED, TOO_OLD.format(number))
        if self.request(number, index or 0, call.sender, call.now_ns):
            return CommandAnswer(ACCEPTED)
        if number in self._indexed:
            return CommandAnswer(DENIED, f"message {number} has no index {call.param2:g}")
        return self._request_later(number, call)

    async def _request_later(self, number: int, call: CommandCall) -> CommandAnswer:
        """Answer when the robot has sent the values: QGroundControl does not ask a second time."""
        source = self._vehicle.catalogue.find(number)
        if source is not None and source.prepare is not None:
            with suppress(RemoteError):
                await source.prepare(call.now_ns)
        if self.request(number, 0, call.sender, self._vehicle.snapshot.now_ns):
            return CommandAnswer(ACCEPTED)
        words = f"message {number}: the robot does not send its values now"
        return CommandAnswer(LATER, words)

    def _set_interval(self, call: CommandCall) -> CommandAnswer:
        number, interval_us = whole(call.param1), whole(call.param2)
        if number is None or interval_us is None or interval_us < -1:
            words = "parameter 1 must be the id of a message, 2 its interval in us"
            return CommandAnswer(DENIED, words)
        if call.sender.is_mavlink1 and number > MAVLINK_1_LAST:
            return CommandAnswer(FAILED, TOO_OLD.format(number))
        interval_us = min(interval_us, MAX_INTERVAL_US)
        is_set = self._scheduler.set_interval(call.sender.client, number, interval_us, call.now_ns)
        return CommandAnswer(ACCEPTED) if is_set else CommandAnswer(FAILED, f"no stream {number}")

    def _get_interval(self, call: CommandCall) -> CommandAnswer:
        number = whole(call.param1)
        if number is None or not 0 <= number <= MAX_INTERVAL_NUMBER:
            return CommandAnswer(DENIED, "parameter 1 must be the id of a message")
        self.request(INTERVAL, number, call.sender, call.now_ns)
        is_known = self._vehicle.catalogue.find(number) is not None
        return CommandAnswer(ACCEPTED) if is_known else CommandAnswer(FAILED, f"no stream {number}")

    def _version(self, call: CommandCall) -> CommandAnswer:
        if call.param1 != 1.0:
            return CommandAnswer(DENIED, "parameter 1 must be 1")
        self.request(mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION, 0, call.sender, call.now_ns)
        return CommandAnswer(ACCEPTED)

    def _modes(self, index: int, sender: Sender, now_ns: int) -> Sequence[MavMessage]:
        self._scheduler.begin(sender.client, CurrentMode.id, MODE_US, now_ns)
        return ardupilot.available_modes(index)

    def _interval(self, number: int, sender: Sender, now_ns: int) -> Sequence[MavMessage]:
        if not 0 <= number <= MAX_INTERVAL_NUMBER:
            return ()
        interval_us = self._scheduler.interval_us(sender.client, number, now_ns)
        return (mavlink.MAVLink_message_interval_message(number, interval_us),)
