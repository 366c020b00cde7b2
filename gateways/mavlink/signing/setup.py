"""SETUP_SIGNING: a client sets the key, or ends signing with a key of zeros.

Only while the robot is disarmed, and only from this machine or signed with the present key. The
message holds the secret: it is never recorded, logged or forwarded.
"""

from typing import Final

from gateways.mavlink.dialect import MavMessage, mavlink
from gateways.mavlink.signing.guard import SigningGuard
from gateways.mavlink.traffic import Sender
from gateways.mavlink.vehicle import Vehicle
from ground.user.mavlink_keys import NO_KEY
from protocol.wire.enums import Severity
from runtime.errors import UserError

ARMED: Final = (
    "signing: the key changes only while all robots are disarmed, and this one is seen to be"
)
STRANGER: Final = "signing: the key changes only from this machine, or signed with the present key"
NEEDED: Final = "signing: an endpoint requires it, so it cannot be ended here"


class SigningSetup:
    """Changes the key of the gateway for clients of one vehicle."""

    handles = (mavlink.MAVLINK_MSG_ID_SETUP_SIGNING,)

    def __init__(self, vehicle: Vehicle, guard: SigningGuard) -> None:
        self._vehicle = vehicle
        self._guard = guard
        guard.watch(lambda: vehicle.is_armed)

    def receive(self, message: MavMessage, sender: Sender, now_ns: int) -> None:
        """Change the key, or refuse with a text; a repetition changes nothing."""
        secret = bytes(message.secret_key)
        wanted = None if secret == NO_KEY else secret
        words = self._refusal(sender, wanted)
        if not words and not self._is_in_force(wanted):
            try:
                self._guard.replace_key(wanted)
            except UserError as error:
                words = f"signing: {error}"
        if words:
            self._vehicle.refusals.say(words, sender.client, now_ns, Severity.ERROR)

    def due(self, now_ns: int) -> None:
        """Do nothing: no state of this service depends on time."""

    def forget(self, client: int) -> None:
        """Keep nothing for a client."""

    def _is_in_force(self, wanted: bytes | None) -> bool:
        return not self._guard.is_signing if wanted is None else self._guard.is_current(wanted)

    def _refusal(self, sender: Sender, wanted: bytes | None) -> str:
        is_local = sender.is_loopback and sender.may_command
        if not (sender.is_signed or is_local):
            return STRANGER
        if self._vehicle.snapshot.status is None or self._guard.is_any_armed:
            return ARMED
        if wanted is None and self._guard.is_required:
            return NEEDED
        return ""
