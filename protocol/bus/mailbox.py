"""Mailbox with the newest valid message of a topic, stored by one reference."""

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
"""Limit of valid stamps: 146 years. Sums of a valid stamp and a duration still fit the wire."""

MAX_AHEAD_NS: Final = 10_000_000_000
"""Largest plausible step between the stamps of two successive messages of one sender."""

MAX_SENDERS: Final = 16
"""Operators whose newest message is kept; those with the newest messages are kept."""

MAX_ENCODING: Final = 60
"""Characters shown of an unexpected encoding."""


class Sample(NamedTuple):
    """A received sample: declared encoding, bytes and sending operator.

    `sender` is empty if the key names no operator. `sent_ns` is the sending time of an operator's
    sample on the robot's clock; None if it has no such time.
    """

    encoding: str
    payload: bytes
    sender: str = ""
    sent_ns: int | None = None


class Origin(NamedTuple):
    """Sending operator, sending time (robot's clock) and arrival time of a message.

    `sent_ns` is at most `arrived_ns`: a later one is wrong, as after a jump of the sender's clock,
    and would make the sender's next messages look late.
    """

    sender: str
    sent_ns: int | None
    arrived_ns: int


def opened(sample: Sample, allowed: tuple[type[Message], ...]) -> Message:
    """Return the message in a sample; raise RemoteError unless the key may carry it."""
    if sample.encoding != ENCODING:
        raise RemoteError(foreign(sample.encoding))
    message = decode(sample.payload).message
    if not isinstance(message, allowed):
        names = " or ".join(cls.__name__ for cls in allowed)
        raise RemoteError(f"carries {type(message).__name__}, not {names}")
    return message


def foreign(encoding: str) -> str:
    """Return why an encoding is not ours; the text names both versions."""
    encoding = printable(encoding[:MAX_ENCODING])
    family, _, dialect = encoding.partition(";")
    if family == ENCODING_FAMILY and dialect:
        return f"has dialect {dialect}, not {DIALECT}"
    return f"is encoded as {encoding or 'nothing'}, not as {ENCODING}"


class Mailbox(Generic[M]):
    """The newest message of one topic of one robot. Only one thread may read it.

    `store` is called by the bus, from any thread. A sample that cannot be decoded is counted, and
    its error kept in `last_rejection`; it neither replaces a message nor notifies.

    `accept`: ignore senders for which it returns False, and samples that their sender sent before
    its newest one; keep the newest message of each sender, for `received`. `forward`: while the
    newest message is fresh, reject messages stamped before it or far ahead of it, as caused by the
    network or an attacker. `check`: reject messages for which it returns an error text.
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
        self._slot: tuple[M, int] | None = None
        # By sender; replaced as a whole, so that reads need no lock.
        self._of: dict[str, tuple[M, Origin]] = {}
        self._read: dict[str, tuple[M, Origin]] = {}
        self._storing = threading.Lock()

    def store(self, sample: Sample, arrived_ns: int) -> None:
        """Store a sample if it is valid; called by the bus."""
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
            self._slot = message, arrived_ns
            if self._accept is not None:
                sent_ns = None if sample.sent_ns is None else min(sample.sent_ns, arrived_ns)
                self._keep(message, Origin(sample.sender, sent_ns, arrived_ns))
        if self._notify is not None:
            self._notify(arrived_ns)

    def latest(self) -> tuple[M, int] | None:
        """Return the newest message and its arrival time."""
        return self._slot

    def received(self) -> list[tuple[M, Origin]]:
        """Return the newest message of each operator that sent one since the last call."""
        before, self._read = self._read, self._of
        return [one for sender, one in self._read.items() if before.get(sender) is not one]

    def fresh(self, now_ns: int) -> M | None:
        """Return the newest message; None if it is older than the topic's stale-after."""
        newest = self.latest()
        if newest is None:
            return None
        limit_ns = self.topic.stale_after_ns
        return None if limit_ns and now_ns - newest[1] > limit_ns else newest[0]

    def _implausible(self, message: M, arrived_ns: int) -> str:
        """Return what is wrong with the stamp of a message; empty if nothing is."""
        stamp_ns = stamp_of(message)
        if stamp_ns >= MAX_STAMP_NS:
            return "has an invalid time stamp"
        if not self._forward or self._slot is None:
            return ""
        newest, newest_arrived_ns = self._slot
        if arrived_ns - newest_arrived_ns > self.topic.stale_after_ns:
            return ""
        if stamp_ns < stamp_of(newest):
            return "is older than the one before it"
        ahead = stamp_ns - stamp_of(newest) > MAX_AHEAD_NS
        return "is far ahead of the one before it" if ahead else ""

    def _overtaken(self, sample: Sample) -> bool:
        """Return whether the newest message was sent after this one by the same sender."""
        newest = self._of.get(sample.sender)
        if newest is None or newest[1].sent_ns is None or sample.sent_ns is None:
            return False
        return sample.sent_ns < newest[1].sent_ns

    def _keep(self, message: M, origin: Origin) -> None:
        others = [one for one in self._of.items() if one[0] != origin.sender]
        self._of = dict([*others[1 - MAX_SENDERS :], (origin.sender, (message, origin))])

    def _reject(self, why: str) -> None:
        with self._storing:
            self._count(why)

    def _count(self, why: str) -> None:
        self.rejected += 1
        self.last_rejection = why


def stamp_of(message: Message) -> int:
    """Return the time stamp of a message on its sender's clock; 0 if it has none."""
    stamp_ns: int = getattr(message, "time_ns", 0)
    return stamp_ns
