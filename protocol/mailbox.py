"""The newest message of a topic: whole, of its kind, and stored by one reference."""

import threading
from collections.abc import Callable
from typing import Generic, NamedTuple, TypeVar, cast

from protocol.codec import decode
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


def foreign(encoding: str) -> str:
    """Why an encoding is not ours, with both versions named."""
    family, _, dialect = encoding.partition(";")
    if family == ENCODING_FAMILY and dialect:
        return f"speaks {dialect}, this is {DIALECT}"
    return f"is encoded as {encoding or 'nothing'}, not as {ENCODING}"


class Mailbox(Generic[M]):
    """One topic of one robot, as its reader sees it. Read it from one thread only.

    `store` is the bus's side and may be called from any thread. What cannot be read is counted and
    named in `last_rejection`; it neither takes the place of a message nor wakes anybody. With
    `accept` only what comes from a sender that it says yes to is stored. With `forward` what was
    stamped before the newest one is rejected, too, while that one is fresh: it was sent once more,
    by the network or by somebody.
    """

    def __init__(
        self,
        topic: Topic[M],
        notify: Callable[[int], None] | None = None,
        accept: Callable[[str], bool] | None = None,
        *,
        forward: bool = False,
    ) -> None:
        self.topic = topic
        self.rejected = 0
        self.last_rejection = ""
        self._notify = notify
        self._accept = accept
        self._forward = forward
        self._slot: tuple[M, int] | None = None
        self._storing = threading.Lock()

    def store(self, sample: Sample, arrived_ns: int) -> None:
        try:
            message = cast(M, opened(sample, self.topic.messages))
        except RemoteError as error:
            self._reject(str(error))
            return
        if self._accept is not None and not self._accept(sample.sender):
            return
        if self._forward:
            with self._storing:
                if self._passed(message, arrived_ns):
                    self._count(f"{type(message).__name__} is older than the one before it")
                    return
                self._slot = (message, arrived_ns)
        else:
            self._slot = (message, arrived_ns)
        if self._notify is not None:
            self._notify(arrived_ns)

    def latest(self) -> tuple[M, int] | None:
        """The newest message and when it arrived."""
        return self._slot

    def fresh(self, now_ns: int) -> M | None:
        """The newest message; None when it is older than the topic's stale-after."""
        newest = self._slot
        if newest is None:
            return None
        limit_ns = self.topic.stale_after_ns
        return None if limit_ns and now_ns - newest[1] > limit_ns else newest[0]

    def _passed(self, message: M, arrived_ns: int) -> bool:
        if self._slot is None:
            return False
        newest, heard_ns = self._slot
        backward = stamp_of(message) < stamp_of(newest)
        return backward and arrived_ns - heard_ns <= self.topic.stale_after_ns

    def _reject(self, why: str) -> None:
        with self._storing:
            self._count(why)

    def _count(self, why: str) -> None:
        self.rejected += 1
        self.last_rejection = why


def stamp_of(message: Message) -> int:
    """When it was made, by its maker's clock; 0 for one that does not say."""
    stamp_ns: int = getattr(message, "time_ns", 0)
    return stamp_ns
