"""Texts about a robot that is silent: once to each client, and again when it is back."""

from typing import Final

from gateways.mavlink.dialect import MavMessage
from gateways.mavlink.port import NO_TELEMETRY
from gateways.mavlink.traffic import Sender
from gateways.mavlink.vehicle import SILENT_NS, Vehicle
from protocol.wire.enums import Severity
from runtime.units import NS_PER_S

SILENT: Final = f"{NO_TELEMETRY}: commands are refused, but stops are sent"


class SilenceTexts:
    """Says why nothing is live any more."""

    handles = ()

    def __init__(self, vehicle: Vehicle) -> None:
        self._vehicle = vehicle
        self._heard_ns: int | None = None
        self._told: set[int] = set()

    def receive(self, message: MavMessage, sender: Sender, now_ns: int) -> None:
        """Take no message."""

    def due(self, now_ns: int) -> None:
        """Send a text if the telemetry has ended or is back."""
        vehicle = self._vehicle
        if self._heard_ns is None:
            self._heard_ns = now_ns
        if vehicle.snapshot.is_live:
            seconds = (now_ns - self._heard_ns) / NS_PER_S
            for client in self._told:
                words = f"telemetry arrives again, after {seconds:.0f} s"
                vehicle.outbox.text(Severity.NOTICE, words, client)
            self._heard_ns = now_ns
            self._told.clear()
        elif now_ns - self._heard_ns >= SILENT_NS:
            for client in vehicle.clients.keys() - self._told:
                vehicle.outbox.text(Severity.CRITICAL, SILENT, client)
                self._told.add(client)

    def forget(self, client: int) -> None:
        """Drop what is kept for a client that has disconnected."""
        self._told.discard(client)
