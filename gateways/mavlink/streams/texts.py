"""STATUSTEXT: the robot's texts, forwarded to all clients."""

from gateways.mavlink.dialect import MavMessage
from gateways.mavlink.traffic import Sender
from gateways.mavlink.vehicle import Vehicle
from ground.text.statustext import StatustextAssembler
from protocol.wire.enums import Severity


class RobotTexts:
    """Joins the pieces of the robot's texts and sends each under a number of this vehicle."""

    handles = ()

    def __init__(self, vehicle: Vehicle) -> None:
        self._vehicle = vehicle
        self._assembler = StatustextAssembler()

    def receive(self, message: MavMessage, sender: Sender, now_ns: int) -> None:
        """Take no message."""

    def due(self, now_ns: int) -> None:
        """Forward the texts that have arrived."""
        for piece in self._vehicle.port.new_texts():
            words = self._assembler.receive(piece)
            if words:
                severity = min(max(piece.severity, Severity.EMERGENCY), Severity.DEBUG)
                self._vehicle.outbox.text(Severity(severity), words)

    def forget(self, client: int) -> None:
        """Keep nothing for a client."""
