"""Verify the signatures of received frames, before any protocol sees them.

The signature is checked first: a forged frame changes nothing here. pymavlink stores the time stamp
of a frame before it checks the signature. One forged stamp from the future then locks the owner
out, so its check is not used.
"""

from enum import Enum
from hashlib import sha256
from hmac import compare_digest
from typing import Final, NamedTuple

from gateways.mavlink.clients.framing import Frame
from gateways.mavlink.signing.stamps import PER_S, StampClock

MINUTE: Final = 60 * PER_S
"""Largest difference of a stamp to the present: before it for a new stream, after it for any.

Clients set their stamps forward to those that they receive.
"""
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


class Accepted(NamedTuple):
    """The newest stamp of a stream, and the time of its arrival as a stamp."""

    stamp: int
    at: int


class Verifier:
    """The keys, and the newest stamp of each stream: link id, system and component.

    `keys` are the valid ones. Without keys every frame counts as unsigned.
    """

    def __init__(self, clock: StampClock, keys: tuple[bytes, ...] = ()) -> None:
        self.keys = keys
        self._clock = clock
        self._streams: dict[tuple[int, int, int], Accepted] = {}

    def check(self, frame: Frame) -> Verdict:
        """Return the verdict on a frame; only a valid one changes the state."""
        if not (frame.is_signed and self.keys):
            return Verdict.UNSIGNED
        if not any(_is_signed_by(key, frame.data) for key in self.keys):
            return Verdict.FORGED
        stamp = int.from_bytes(frame.data[STAMP], "little")
        stream = (frame.data[LINK_AT], frame.system, frame.component)
        if stamp > self._clock.newest + MINUTE:
            return Verdict.FUTURE
        known = self._streams.get(stream)
        if stamp <= self._oldest(known) or (known is None and len(self._streams) >= MAX_STREAMS):
            return Verdict.REPLAYED
        self._streams[stream] = Accepted(stamp, self._clock.now())
        self._clock.accept(stamp)
        return Verdict.VALID

    def _oldest(self, known: Accepted | None) -> int:
        """Return the stamp that the next one of a stream must exceed.

        A stream that was silent must have advanced meanwhile. Otherwise frames that were
        recorded on their way, and never arrived, could be sent much later.
        """
        now = self._clock.now()
        if known is None:
            return max(now - MINUTE, self._clock.floor)
        return max(known.stamp, known.stamp + now - known.at - MINUTE)


def _is_signed_by(key: bytes, data: bytes) -> bool:
    signature = sha256(key + data[:-6]).digest()[:6]
    return compare_digest(signature, data[SIGNATURE])
