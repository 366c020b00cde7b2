"""A network of the judge in simulated time: the vehicle runs in the same thread."""

from typing import Protocol

from vehicle_check.ground_stations import Heard

STEP_NS = 10_000_000


class InProcessVehicle(Protocol):
    """A vehicle whose frames for each peer are taken from `sends`."""

    sends: list[tuple[int, bytes]]

    def receive(self, peer: int, data: bytes, now_ns: int) -> None:
        """Process bytes of one peer."""

    def due(self, now_ns: int) -> None:
        """Let time pass."""


class MemoryNetwork:
    """Connections to vehicles in this process; the time advances only while the judge waits."""

    is_stream = False
    is_loopback = False

    def __init__(self, *vehicles: InProcessVehicle) -> None:
        self._vehicles = vehicles
        self._now_ns = 1_000_000_000
        self._due_ns = 0
        self._peers = 0
        self.is_closed = False

    def now_ns(self) -> int:
        """Return the simulated time."""
        return self._now_ns

    def open(self) -> int:
        """Open one more connection."""
        self._peers += 1
        return self._peers - 1

    def send(self, peer: int, data: bytes) -> None:
        """Give bytes to all vehicles, which share one port."""
        for vehicle in self._vehicles:
            vehicle.receive(peer, data, self._now_ns)

    def receive(self, until_ns: int) -> list[Heard]:
        """Advance the time until something arrives."""
        while True:
            found = self._taken()
            if found or self._now_ns >= until_ns:
                return found
            self._now_ns = min(self._now_ns + STEP_NS, until_ns)
            if self._now_ns >= self._due_ns:
                self._due_ns = self._now_ns + STEP_NS
                for vehicle in self._vehicles:
                    vehicle.due(self._now_ns)

    def close(self) -> None:
        """Note it."""
        self.is_closed = True

    def _taken(self) -> list[Heard]:
        found = []
        for vehicle in self._vehicles:
            sends, vehicle.sends = vehicle.sends, []
            found += [Heard(peer, data, self._now_ns) for peer, data in sends]
        return found
