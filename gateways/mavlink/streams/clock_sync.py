"""TIMESYNC and PING: answered at once, so that clients measure the delay and the offset."""

from typing import Final

from gateways.mavlink.dialect import MavMessage, TimeSync, mavlink
from gateways.mavlink.traffic import Sender
from gateways.mavlink.vehicle import Vehicle

EVERYONE: Final = 0


class ClockSync:
    """Answers with the time of the messages of this vehicle."""

    handles = (mavlink.MAVLINK_MSG_ID_TIMESYNC, mavlink.MAVLINK_MSG_ID_PING)

    def __init__(self, vehicle: Vehicle) -> None:
        self._vehicle = vehicle

    def receive(self, message: MavMessage, sender: Sender, now_ns: int) -> None:
        """Answer a request; note an answer to one of this vehicle."""
        answer = None
        if message.get_msgId() == mavlink.MAVLINK_MSG_ID_TIMESYNC:
            if message.tc1 == 0:
                boot_ns = self._vehicle.boot_ns(now_ns)
                answer = TimeSync(boot_ns, message.ts1, sender.system, sender.component)
        elif message.target_system == EVERYONE == message.target_component:
            fields = (message.time_usec, message.seq, sender.system, sender.component)
            answer = mavlink.MAVLink_ping_message(*fields)
        elif message.target_system == self._vehicle.system:
            self._vehicle.control.answered(sender)
        if answer is not None:
            self._vehicle.outbox.send(answer, sender.client)

    def due(self, now_ns: int) -> None:
        """Ask for nothing."""

    def forget(self, client: int) -> None:
        """Keep nothing for a client."""
