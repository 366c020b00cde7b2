"""The emergency stop on its way from the bus to the loop: a latch that nothing can fill or block.

The bus's thread sets it, with whatever bytes came; the loop takes it before everything else. How
many stops arrive in between makes no difference: one is enough.
"""

from collections import deque
from collections.abc import Callable
from typing import Final, NamedTuple

from protocol.wire.codec import decode
from protocol.wire.enums import Command
from protocol.wire.messages import CommandRequest
from runtime.errors import RemoteError

KEPT: Final = 8
"""Frames kept until the loop takes them, of the lease's holder and of all others; they only tell
whose stop it was."""


class StopRequest(NamedTuple):
    """A stop as it arrived: who sent it, empty when unknown, and its bytes."""

    operator: str
    frame: bytes


class StopLatch:
    """`is_holder` tells whether an operator holds the lease: its frames are not pushed out by a
    flood of others, so that the holder sees its own stop acknowledged."""

    def __init__(self, is_holder: Callable[[str], bool]) -> None:
        self._is_holder = is_holder
        self._holders: deque[StopRequest] = deque(maxlen=KEPT)
        self._others: deque[StopRequest] = deque(maxlen=KEPT)

    def press(self, operator: str, frame: bytes) -> None:
        """Set the latch; may be called from any thread, as often as one likes."""
        pressed = self._holders if operator and self._is_holder(operator) else self._others
        pressed.append(StopRequest(operator, frame))

    def take(self) -> CommandRequest | None:
        """Return the stop to act on and reset the latch; None when nobody has pressed.

        The newest of the holder's stops if there is one, else the newest of the others.
        """
        newest = drained(self._others)
        newest = drained(self._holders) or newest
        return None if newest is None else stop_in(newest.frame)


def drained(pressed: "deque[StopRequest]") -> StopRequest | None:
    """Remove what is there now and return the newest; what arrives meanwhile stays."""
    newest = None
    for _ in range(len(pressed)):
        newest = pressed.popleft()
    return newest


def stop_in(frame: bytes) -> CommandRequest:
    """Return the request in a frame; one with id 0 for bytes that are none, which stop as well."""
    try:
        message = decode(frame).message
    except RemoteError:
        message = None
    request_id = message.request_id if isinstance(message, CommandRequest) else 0
    return emergency_stop(request_id)


def emergency_stop(request_id: int) -> CommandRequest:
    """Return the request for an emergency stop."""
    return CommandRequest(
        request_id=request_id, param1=1.0, param2=0.0, command=Command.DO_FLIGHTTERMINATION
    )
