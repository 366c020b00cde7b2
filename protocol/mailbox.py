"""The newest frame of a topic: stored by one reference, decoded only when somebody looks."""

import threading
from collections.abc import Callable
from typing import Generic, NamedTuple, TypeVar, cast

from protocol.codec import decode, framed
from protocol.errors import RemoteError
from protocol.message import Message
from protocol.topics import DIALECT, ENCODING, ENCODING_FAMILY, Topic

M = TypeVar("M", bound=Message)


class Sample(NamedTuple):
    """What arrived on a key: how it says it is encoded, its bytes, and which operator it is from.

    `sender` is empty for whoever is no operator.
    """

    encoding: str
    payload: bytes
    sender: str = ""


def opened(sample: Sample, allowed: tuple[type[Message], ...]) -> Message:
    """The message in a sample; RemoteError when it is not one of those the key may carry."""
    if sample.encoding != ENCODING:
        raise RemoteError(foreign(sample.encoding))
    message = decode(sample.payload).message
    if not isinstance(message, allowed):
        names = " or ".join(cls.__name__ for cls in allowed)
        raise RemoteError(f"carries {type(message).__name__}, not {names}")
    return message


def misfit(sample: Sample) -> str:
    """Why a sample cannot be one of ours, as far as its outside tells; empty when it can."""
    if sample.encoding == ENCODING and framed(sample.payload):
        return ""
    try:
        opened(sample, ())
    except RemoteError as error:
        return str(error)
    return ""


def foreign(encoding: str) -> str:
    """Why an encoding is not ours, with both versions named."""
    family, _, dialect = encoding.partition(";")
    if family == ENCODING_FAMILY and dialect:
        return f"speaks {dialect}, this is {DIALECT}"
    return f"is encoded as {encoding or 'nothing'}, not as {ENCODING}"


class Mailbox(Generic[M]):
    """One topic of one robot, as its reader sees it. Read it from one thread only.

    `store` is the bus's side and may be called from any thread: a look at the outside, so that
    noise neither takes the place of a message nor wakes anybody, and one reference store. What
    cannot be read is counted and named in `last_rejection`; the last good message stays. With
    `accept` only what comes from a sender that it says yes to is stored.
    """

    def __init__(
        self,
        topic: Topic[M],
        notify: Callable[[int], None] | None = None,
        accept: Callable[[str], bool] | None = None,
    ) -> None:
        self.topic = topic
        self.rejected = 0
        self.last_rejection = ""
        self._notify = notify
        self._accept = accept
        self._slot: tuple[Sample, int] | None = None
        self._judged: tuple[Sample, int] | None = None
        self._good: tuple[M, int] | None = None
        self._rejecting = threading.Lock()

    def store(self, sample: Sample, arrived_ns: int) -> None:
        why = misfit(sample)
        if why:
            self._reject(why)
            return
        if self._accept is not None and not self._accept(sample.sender):
            return
        self._slot = (sample, arrived_ns)
        if self._notify is not None:
            self._notify(arrived_ns)

    def latest(self) -> tuple[M, int] | None:
        """The newest readable message and when it arrived."""
        slot = self._slot
        if slot is not self._judged and slot is not None:
            self._judged = slot
            self._judge(slot)
        return self._good

    def fresh(self, now_ns: int) -> M | None:
        """The newest message; None when it is older than the topic's stale-after."""
        good = self.latest()
        if good is None:
            return None
        limit_ns = self.topic.stale_after_ns
        return None if limit_ns and now_ns - good[1] > limit_ns else good[0]

    def _judge(self, slot: tuple[Sample, int]) -> None:
        try:
            message = opened(slot[0], self.topic.messages)
        except RemoteError as error:
            self._reject(str(error))
            return
        self._good = (cast(M, message), slot[1])

    def _reject(self, why: str) -> None:
        with self._rejecting:
            self.rejected += 1
            self.last_rejection = why
