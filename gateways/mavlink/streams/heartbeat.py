"""HEARTBEAT, once a second and at once when it changes (rows 1 and 2 of the checklist).

One that is sent because of a change does not delay the next regular one.
A client does nothing before its first heartbeat: one that has joined gets it at once, and again
0.2 s later in case that the first is lost.
"""

from typing import Final

from gateways.mavlink import ardupilot
from gateways.mavlink.dialect import MavMessage
from gateways.mavlink.traffic import Sender
from gateways.mavlink.vehicle import SILENT_NS, Vehicle
from runtime.units import NS_PER_MS, NS_PER_S

PERIOD_NS: Final = NS_PER_S
AGAIN_NS: Final = 200 * NS_PER_MS


class HeartbeatStream:
    """Sends the heartbeat to all clients."""

    handles = ()

    def __init__(self, vehicle: Vehicle) -> None:
        self._vehicle = vehicle
        self._sent: ardupilot.State | None = None
        self._due_ns: int | None = None
        self._live_ns = -SILENT_NS
        self._greeted: set[int] = set()
        self._again_ns: dict[int, int] = {}

    def receive(self, message: MavMessage, sender: Sender, now_ns: int) -> None:
        """Take no message."""

    def due(self, now_ns: int) -> None:
        """Send the heartbeat if its second is over or the state has changed."""
        state = self._state(now_ns)
        newcomers = self._vehicle.clients.keys() - self._greeted
        receivers = [*newcomers, *(key for key, at_ns in self._again_ns.items() if now_ns >= at_ns)]
        is_due = self._due_ns is None or now_ns >= self._due_ns
        if is_due:
            late_ns = now_ns - (self._due_ns or now_ns)
            self._due_ns = now_ns + PERIOD_NS - (late_ns if late_ns < PERIOD_NS else 0)
        if state != self._sent or is_due:
            self._sent = state
            self._vehicle.outbox.send(state.heartbeat())
        else:
            for client in receivers:
                self._vehicle.outbox.send(state.heartbeat(), client)
        for client in receivers:
            self._again_ns.pop(client, None)
        self._again_ns |= dict.fromkeys(newcomers, now_ns + AGAIN_NS)
        self._greeted |= newcomers

    def _state(self, now_ns: int) -> ardupilot.State:
        """Return the state; after the last status, that one for a second: it may be delayed."""
        vehicle = self._vehicle
        if vehicle.snapshot.is_live:
            self._live_ns = now_ns
        elif self._sent is not None and now_ns < self._live_ns + SILENT_NS:
            return self._sent
        number = vehicle.modes.number
        return ardupilot.state_of(vehicle.snapshot, number, was_armed=vehicle.is_armed)

    def forget(self, client: int) -> None:
        """Drop what is kept for a client that has gone."""
        self._greeted.discard(client)
        self._again_ns.pop(client, None)
