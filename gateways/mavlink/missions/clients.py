"""Answers to the client of a transfer."""

from typing import Final

from gateways.mavlink.dialect import MissionAck
from gateways.mavlink.missions.results import ACCEPTED, Refusal
from gateways.mavlink.traffic import Sender
from gateways.mavlink.vehicle import Vehicle
from protocol.wire.enums import Severity
from runtime.units import NS_PER_MS

AGAIN_NS: Final = (700 * NS_PER_MS, 1400 * NS_PER_MS)
"""On a lossy line the result of an upload is sent again after these times, unless the client goes
on: MAVSDK and mavros give up some seconds later, and repeat nothing themselves."""
ClientKey = tuple[int, int, int, bool]


def key_of(sender: Sender) -> ClientKey:
    """Return the key of a client. A peer with and without the right to command has two keys."""
    return sender.client, sender.system, sender.component, sender.may_command


class Answers:
    """Sends the result of a transfer, and the reason of a refusal."""

    def __init__(self, vehicle: Vehicle) -> None:
        self._vehicle = vehicle
        self._again: dict[ClientKey, list[tuple[int, Sender, MissionAck]]] = {}

    def acknowledge(
        self, sender: Sender, kind: int, result: int = ACCEPTED, opaque_id: int = 0
    ) -> None:
        """Send a MISSION_ACK."""
        ack = MissionAck(sender.system, sender.component, result, kind, opaque_id)
        self._vehicle.outbox.send(ack, sender.client)

    def end(self, sender: Sender, kind: int, result: int, opaque_id: int) -> None:
        """Send the result of an upload; on a lossy line, plan to repeat that it was accepted.

        A refusal is not repeated: its copy could end the next upload of a client whose first
        message was lost. A client without the result reports that the upload has failed.
        """
        self.acknowledge(sender, kind, result, opaque_id)
        if result == ACCEPTED and sender.client in self._vehicle.lossy:
            ack = MissionAck(sender.system, sender.component, result, kind, opaque_id)
            now_ns = self._vehicle.snapshot.now_ns
            self._again[key_of(sender)] = [(now_ns + one, sender, ack) for one in AGAIN_NS]

    def heard(self, sender: Sender) -> None:
        """Repeat nothing more to a client that has gone on."""
        self._again.pop(key_of(sender), None)

    def due(self, now_ns: int) -> None:
        """Repeat what is due."""
        for key, planned in list(self._again.items()):
            at_ns, sender, ack = planned[0]
            if now_ns >= at_ns:
                self._vehicle.outbox.send(ack, sender.client)
                self._again[key] = planned[1:]
            if not self._again[key]:
                del self._again[key]

    def forget(self, client: int) -> None:
        """Drop what is kept for a client that has gone."""
        for key in [key for key in self._again if key[0] == client]:
            del self._again[key]

    def refuse(self, sender: Sender, kind: int, refusal: Refusal) -> None:
        """Send a MISSION_ACK with a result, and a STATUSTEXT with the reason."""
        self.say(sender, refusal.words)
        self.acknowledge(sender, kind, refusal.result)

    def say(self, sender: Sender, words: str, severity: Severity = Severity.WARNING) -> None:
        """Send a STATUSTEXT to a client."""
        vehicle = self._vehicle
        vehicle.refusals.say(words, sender.client, vehicle.snapshot.now_ns, severity)
