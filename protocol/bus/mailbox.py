"""The newest message of a topic: whole, of its kind, and stored by one reference."""

import threading
from collections.abc import Callable
from typing import Final, Generic, NamedTuple, TypeVar, cast

from protocol.topics import DIALECT, ENCODING, ENCODING_FAMILY, Topic
from protocol.wire.codec import decode
from protocol.wire.message import Message
from runtime.cli.terminal import printable
from runtime.errors import RemoteError

M = TypeVar("M", bound=Message)
MAX_STAMP_NS: Final = 1 << 62
"""A stamp beyond, 146 years, is no time. What is added to one below still fits the wire."""

MAX_AHEAD_NS: Final = 10_000_000_000
"""A stamp so far ahead of one that has just arrived is no time of the same sender."""

MAX_ENCODING: Final = 60
"""Characters shown of an encoding that is not ours."""


class Sample(NamedTuple):
    """What arrived on a key: its declared encoding, its bytes, and the operator that sent it.

    `sender` is empty when the key names no operator. `sent_ns` is when an operator sent it, on the
    robot's clock; None when it does not say.
    """

    encoding: str
    payload: bytes
    sender: str = ""
    sent_ns: int | None = None


class Origin(NamedTuple):
    """Which operator a message is from, when it was sent (robot's clock) and when it arrived."""

    sender: str
    sent_ns: int | None
    arrived_ns: int


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
    encoding = printable(encoding[:MAX_ENCODING])
    family, _, dialect = encoding.partition(";")
    if family == ENCODING_FAMILY and dialect:
        return f"speaks {dialect}, this is {DIALECT}"
    return f"is encoded as {encoding or 'nothing'}, not as {ENCODING}"


class Mailbox(Generic[M]):
    """One topic of one robot, as its reader sees it. Read it from one thread only.

    `store` is the bus's side and may be called from any thread. What cannot be read is counted and
    named in `last_rejection`; it neither replaces a message nor notifies. With `accept`, messages
    of senders for which it returns False are ignored, and so are those that their sender sent
    before its newest one. With `forward`, a message stamped before the newest one, or far ahead of
    it, is rejected, too, while that one is fresh: the network or an attacker has sent it. With
    `check`, which says what is wrong with a message, so is one with which something is wrong.
    """

    def __init__(
        self,
        topic: Topic[M],
        notify: Callable[[int], None] | None = None,
        accept: Callable[[str], bool] | None = None,
        *,
        forward: bool = False,
        check: Callable[[M], str] | None = None,
    ) -> None:
        self.topic = topic
        self.rejected = 0
        self.last_rejection = ""
        self._notify = notify
        self._accept = accept
        self._forward = forward
        self._check = check
        self._slot: tuple[tuple[M, int], Origin] | None = None
        self._storing = threading.Lock()

    def store(self, sample: Sample, arrived_ns: int) -> None:
        try:
            message = cast(M, opened(sample, self.topic.messages))
        except RemoteError as error:
            self._reject(str(error))
            return
        if self._accept is not None and not self._accept(sample.sender):
            return
        with self._storing:
            if why := self._implausible(message, arrived_ns):
                self._count(f"{type(message).__name__} {why}")
                return
            if self._accept is not None and self._overtaken(sample):
                return
            if self._check is not None and (why := self._check(message)):
                self._count(f"{type(message).__name__} {why}")
                return
            origin = Origin(sample.sender, sample.sent_ns, arrived_ns)
            self._slot = ((message, arrived_ns), origin)
        if self._notify is not None:
            self._notify(arrived_ns)

    def latest(self) -> tuple[M, int] | None:
        """Return the newest message and when it arrived."""
        slot = self._slot
        return None if slot is None else slot[0]

    def received(self) -> tuple[M, Origin] | None:
        """Return the newest message and where it is from."""
        slot = self._slot
        return None if slot is None else (slot[0][0], slot[1])

    def fresh(self, now_ns: int) -> M | None:
        """The newest message; None when it is older than the topic's stale-after."""
        newest = self.latest()
        if newest is None:
            return None
        limit_ns = self.topic.stale_after_ns
        return None if limit_ns and now_ns - newest[1] > limit_ns else newest[0]

    def _implausible(self, message: M, arrived_ns: int) -> str:
        """Return what is wrong with the stamp of a message; empty when nothing is."""
        stamp_ns = stamp_of(message)
        if stamp_ns >= MAX_STAMP_NS:
            return "has a stamp that is no time"
        if not self._forward or self._slot is None:
            return ""
        newest, heard_ns = self._slot[0]
        if arrived_ns - heard_ns > self.topic.stale_after_ns:
            return ""
        if stamp_ns < stamp_of(newest):
            return "is older than the one before it"
        ahead = stamp_ns - stamp_of(newest) > MAX_AHEAD_NS
        return "is far ahead of the one before it" if ahead else ""

    def _overtaken(self, sample: Sample) -> bool:
        """Return whether its sender has sent the newest message after this one."""
        if self._slot is None or sample.sent_ns is None:
            return False
        newest = self._slot[1]
        if newest.sent_ns is None or newest.sender != sample.sender:
            return False
        return sample.sent_ns < newest.sent_ns

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
