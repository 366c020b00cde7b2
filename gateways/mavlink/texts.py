"""Texts with the reason of a refusal, at a limited rate for each client."""

from typing import Final

from gateways.mavlink.traffic import Outbox
from protocol.wire.enums import Severity
from runtime.units import NS_PER_S

AGAIN_NS: Final = NS_PER_S
"""The same text is sent to a client again only after this time."""
MAX_RECENT: Final = 8
"""Different texts to one client within that time."""


class Refusals:
    """Sends texts of refusals; drops repetitions, and texts beyond a limit."""

    def __init__(self, outbox: Outbox) -> None:
        self._outbox = outbox
        self._recent: dict[int, dict[str, int]] = {}

    def say(
        self, words: str, client: int, now_ns: int, severity: Severity = Severity.WARNING
    ) -> None:
        """Send a text to a client unless the limit is reached."""
        recent = self._recent.setdefault(client, {})
        for old in [old for old, sent_ns in recent.items() if now_ns - sent_ns >= AGAIN_NS]:
            del recent[old]
        if words in recent or len(recent) >= MAX_RECENT:
            return
        recent[words] = now_ns
        self._outbox.text(severity, words, client)

    def forget(self, client: int) -> None:
        """Drop the state of a client that has disconnected."""
        self._recent.pop(client, None)
