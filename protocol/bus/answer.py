"""The answer to a question, out of what came back."""

import zenoh

from protocol.codec import decode
from protocol.errors import NoAnswer
from protocol.mailbox import foreign
from protocol.message import Message
from protocol.topics import ENCODING, ENCODING_FAMILY


def answer_in(sample: zenoh.Sample) -> Message | bytes:
    """A message, or the bytes of a JSON text; NoAnswer when it is one of another version."""
    encoding = str(sample.encoding)
    if not encoding.startswith(ENCODING_FAMILY):
        return sample.payload.to_bytes()
    if encoding != ENCODING:
        raise NoAnswer(f"{sample.key_expr}: {foreign(encoding)}")
    return decode(sample.payload.to_bytes()).message
