"""HEARTBEAT, once a second and at once after a change (rows 1 and 2 of the list)."""

from typing import Final

from ground.gateway import ardupilot
from ground.gateway.dialect import MavMessage
from ground.gateway.traffic import Sender
from ground.gateway.vehicle import Vehicle
from runtime.units import NS_PER_S

PERIOD_NS: Final = NS_PER_S


class HeartbeatStream:
    """Sends the heartbeat to all clients."""

    handles = ()

    def __init__(self, vehicle: Vehicle) -> None:
        self._vehicle = vehicle
        self._sent: ardupilot.State | None = None
        self._due_ns = 0

    def receive(self, message: MavMessage, sender: Sender, now_ns: int) -> None:
        """Take no message."""

    def due(self, now_ns: int) -> None:
        """Send the heartbeat if its second is over or the state has changed."""
        state = ardupilot.state_of(self._vehicle.snapshot, self._vehicle.modes.number)
        if state != self._sent or now_ns >= self._due_ns:
            self._sent, self._due_ns = state, now_ns + PERIOD_NS
            self._vehicle.outbox.send(state.heartbeat())

    def forget(self, client: int) -> None:
        """Keep nothing for a client."""
