"""A latch for the emergency stop, between the bus and the loop, that cannot fill or block.

A thread of the bus sets it with any bytes received; the loop reads it before anything else. Several
stops between two reads count as one.
"""

from collections import deque
from collections.abc import Callable
from typing import Final, NamedTuple

from protocol.wire.codec import decode
from protocol.wire.enums import Command
from protocol.wire.messages import CommandRequest
from runtime.errors import RemoteError

UNREADABLE_ID: Final = 1
"""Id of a stop without one. 0 is shown before the first stop, and named by a clear without one."""

KEPT: Final = 8
"""Frames kept until the loop reads them, of the lease holder and of all others.

They only identify the request of the stop.
"""


class StopRequest(NamedTuple):
    """A stop as received: the sender's identity, empty if unknown, and its bytes."""

    operator: str
    frame: bytes


class StopLatch:
    """The latched stops of the lease holder and of all others.

    `is_holder` returns whether an operator holds the lease. The holder's frames are kept apart, so
    that a flood of others cannot displace them and the holder's own stop is acknowledged.
    """

    def __init__(self, is_holder: Callable[[str], bool]) -> None:
        self._is_holder = is_holder
        self._holders: deque[StopRequest] = deque(maxlen=KEPT)
        self._others: deque[StopRequest] = deque(maxlen=KEPT)
        self.takes = 0
        """How often the loop has begun to read the latch."""

    def press(self, operator: str, frame: bytes) -> None:
        """Set the latch; thread-safe, and may be repeated."""
        pressed = self._holders if operator and self._is_holder(operator) else self._others
        pressed.append(StopRequest(operator, frame))

    def take(self) -> CommandRequest | None:
        """Return the stop to act on and reset the latch; None if it is not set.

        The newest stop of the lease holder comes first, then the newest of the others.
        """
        self.takes += 1
        newest = drained(self._others)
        newest = drained(self._holders) or newest
        return None if newest is None else stop_in(newest.frame)


def drained(pressed: "deque[StopRequest]") -> StopRequest | None:
    """Remove the present entries and return the newest; later arrivals stay."""
    newest = None
    for _ in range(len(pressed)):
        newest = pressed.popleft()
    return newest


def stop_in(frame: bytes) -> CommandRequest:
    """Return the request in a frame; bytes that are no request stop too."""
    try:
        message = decode(frame).message
    except RemoteError:
        message = None
    request_id = message.request_id if isinstance(message, CommandRequest) else UNREADABLE_ID
    return emergency_stop(request_id or UNREADABLE_ID)


def emergency_stop(request_id: int) -> CommandRequest:
    """Return the request for an emergency stop."""
    return CommandRequest(
        request_id=request_id, param1=1.0, param2=0.0, command=Command.DO_FLIGHTTERMINATION
    )
