"""A latch for the emergency stop, between the bus and the loop, that cannot fill or block.

A thread of the bus sets it with any bytes received; the loop reads it before anything else, and
shows one stop after another to those who may clear them.
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
    `is_shown` returns whether the stop with an id is latched and was shown: a copy is not new.
    """

    def __init__(self, is_holder: Callable[[str], bool], is_shown: Callable[[int], bool]) -> None:
        self._is_holder = is_holder
        self._is_shown = is_shown
        self._holders: deque[StopRequest] = deque(maxlen=KEPT)
        self._others: deque[StopRequest] = deque(maxlen=KEPT)
        self._copy_id = 0
        """The copy that was returned last."""
        self.takes = 0
        """How often the loop has begun to read the latch."""

    def press(self, operator: str, frame: bytes) -> None:
        """Set the latch; thread-safe, and may be repeated."""
        pressed = self._holders if operator and self._is_holder(operator) else self._others
        pressed.append(StopRequest(operator, frame))

    def take(self) -> CommandRequest | None:
        """Return the stop to act on; None if the latch is not set.

        It is the newest one that was not shown, of the lease holder if there is one; those that it
        leaves are returned by the next calls. Without such a stop it is a copy of one shown: each
        in its turn, so that every sender sees its own acknowledged.
        """
        self.takes += 1
        copies: dict[int, CommandRequest] = {}
        for pressed in (self._holders, self._others):
            for _ in range(len(pressed)):
                stop = stop_in(pressed.pop().frame)
                if not self._is_shown(stop.request_id):
                    return stop
                copies[stop.request_id] = stop
        if not copies:
            return None
        self._copy_id = min(copies, key=lambda number: (number <= self._copy_id, number))
        return copies[self._copy_id]


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
