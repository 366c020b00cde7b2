"""Sends the streams: default rates, SET_MESSAGE_INTERVAL and REQUEST_DATA_STREAM of each client."""

from typing import Final

from gateways.mavlink.dialect import CurrentMode, MavMessage, mavlink
from gateways.mavlink.streams.client_streams import ClientStreams
from gateways.mavlink.streams.table import STREAMS
from gateways.mavlink.traffic import Sender
from gateways.mavlink.vehicle import Vehicle
from runtime.units import NS_PER_S, NS_PER_US

NOT_SENT_US: Final = -1
MAX_INTERVAL_US: Final = 0x7FFF_FFFF


class StreamScheduler:
    """Sends the due messages to each client; CURRENT_MODE also after a change of the mode."""

    handles = (mavlink.MAVLINK_MSG_ID_REQUEST_DATA_STREAM,)

    def __init__(self, vehicle: Vehicle) -> None:
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
            for streams in self._clients.values():
                streams.hurry(CurrentMode.id, now_ns)
        for client in vehicle.clients:
            known = self._streams(client, now_ns)
            for number in () if known is None else known.take(now_ns):
                for message in vehicle.catalogue.build(number, now_ns):
                    vehicle.outbox.send(message, client)
        periods_ns = (streams.shortest_ns for streams in self._clients.values())
        vehicle.shortest_ns = min(periods_ns, default=NS_PER_S)

    def forget(self, client: int) -> None:
        """Drop the rates of a client that has disconnected."""
        self._clients.pop(client, None)

    def set_interval(self, client: int, number: int, interval_us: int, now_ns: int) -> bool:
        """Set the interval of a message: -1 ends it, 0 is the default. False if it is unknown."""
        streams = self._streams(client, now_ns)
        if streams is None or self._vehicle.catalogue.find(number) is None:
            return False
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
        period_us = streams.period_ns(number) // NS_PER_US
        return min(period_us, MAX_INTERVAL_US) if period_us else NOT_SENT_US

    def _streams(self, client: int, now_ns: int) -> ClientStreams | None:
        found = self._clients.get(client)
        if found is None and client in self._vehicle.clients:
            line_bytes_s = self._vehicle.clients[client]
            found = ClientStreams(self._vehicle.catalogue, line_bytes_s, now_ns)
            self._clients[client] = found
        return found
