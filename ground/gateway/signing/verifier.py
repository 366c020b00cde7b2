"""Verify the signatures of received frames, before any protocol sees them.

The signature is checked first: a forged frame changes nothing here. pymavlink stores the time stamp
of a frame before it checks the signature. One forged stamp from the future then locks the owner
out, so its check is not used.
"""

from enum import Enum
from hashlib import sha256
from hmac import compare_digest
from typing import Final

from ground.gateway.clients.framing import Frame
from ground.gateway.signing.stamps import PER_S, StampClock

MINUTE: Final = 60 * PER_S
"""Largest difference of a stamp to the present: before it for a new stream, after it for any."""
MAX_STREAMS: Final = 256
LINK_AT: Final = -13
STAMP: Final = slice(-12, -6)
SIGNATURE: Final = slice(-6, None)


class Verdict(Enum):
    """The result of the check of a frame."""

    UNSIGNED = "unsigned"
    VALID = "valid"
    FORGED = "forged"
    REPLAYED = "replayed"
    FUTURE = "future"


class Verifier:
    """The keys, and the newest stamp of each stream: link id, system and component.

    `keys` are the valid ones. Without keys every frame counts as unsigned.
    """

    def __init__(self, clock: StampClock, keys: tuple[bytes, ...] = ()) -> None:
        self.keys = keys
        self._clock = clock
        self._streams: dict[tuple[int, int, int], int] = {}

    def check(self, frame: Frame) -> Verdict:
        """Return the verdict on a frame; only a valid one changes the state."""
        if not (frame.is_signed and self.keys):
            return Verdict.UNSIGNED
        if not any(_is_signed_by(key, frame.data) for key in self.keys):
            return Verdict.FORGED
        stamp = int.from_bytes(frame.data[STAMP], "little")
        stream = (frame.data[LINK_AT], frame.system, frame.component)
        if stamp > self._clock.now() + MINUTE:
            return Verdict.FUTURE
        known = self._streams.get(stream)
        oldest = known if known is not None else self._oldest_of_new()
        if stamp <= oldest or (known is None and len(self._streams) >= MAX_STREAMS):
            return Verdict.REPLAYED
        self._streams[stream] = stamp
        self._clock.accept(stamp)
        return Verdict.VALID

    def _oldest_of_new(self) -> int:
        return max(self._clock.now() - MINUTE, self._clock.floor)


def _is_signed_by(key: bytes, data: bytes) -> bool:
    signature = sha256(key + data[:-6]).digest()[:6]
    return compare_digest(signature, data[SIGNATURE])
