"""The answer to a question, out of what came back."""

import zenoh

from protocol.bus.mailbox import foreign
from protocol.topics import ENCODING, ENCODING_FAMILY
from protocol.wire.codec import decode
from protocol.wire.message import Message
from runtime.errors import NoAnswer


def answer_in(sample: zenoh.Sample) -> Message | bytes:
    """A message, or the bytes of a JSON text; NoAnswer when it is one of another version."""
    encoding = str(sample.encoding)
    if not encoding.startswith(ENCODING_FAMILY):
        return sample.payload.to_bytes()
    if encoding != ENCODING:
        raise NoAnswer(f"{sample.key_expr}: {foreign(encoding)}")
    return decode(sample.payload.to_bytes()).message
