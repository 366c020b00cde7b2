"""Answers to the client of a transfer."""

from ground.gateway.dialect import MissionAck
from ground.gateway.missions.results import ACCEPTED, Refusal
from ground.gateway.traffic import Sender
from ground.gateway.vehicle import Vehicle
from protocol.wire.enums import Severity

ClientKey = tuple[int, int, int, bool]


def key_of(sender: Sender) -> ClientKey:
    """Return the key of a client. A peer with and without the right to command has two keys."""
    return sender.client, sender.system, sender.component, sender.may_command


class Answers:
    """Sends the result of a transfer, and the reason of a refusal."""

    def __init__(self, vehicle: Vehicle) -> None:
        self._vehicle = vehicle

    def acknowledge(
        self, sender: Sender, kind: int, result: int = ACCEPTED, opaque_id: int = 0
    ) -> None:
        """Send a MISSION_ACK."""
        ack = MissionAck(sender.system, sender.component, result, kind, opaque_id)
        self._vehicle.outbox.send(ack, sender.client)

    def refuse(self, sender: Sender, kind: int, refusal: Refusal) -> None:
        """Send a MISSION_ACK with a result, and a STATUSTEXT with the reason."""
        self.say(sender, refusal.words)
        self.acknowledge(sender, kind, refusal.result)

    def say(self, sender: Sender, words: str, severity: Severity = Severity.WARNING) -> None:
        """Send a STATUSTEXT to a client."""
        vehicle = self._vehicle
        vehicle.refusals.say(words, sender.client, vehicle.snapshot.now_ns, severity)
