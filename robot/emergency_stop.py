"""The emergency stop: a latch between bus and loop that cannot block, kept over a restart.

A thread of the bus sets the latch with any bytes received; the loop reads it before anything else,
and shows one stop after another to those who may clear them.

A file exists while the stop is latched. Its content is for people: a damaged file, a directory or a
device of this name stops the robot, too, because only an operator may release a stop.

A second file has the ids of the newest requests that released a stop. A client whose answer is lost
repeats its request with the same id, and may do so after a restart and after a newer stop, which
that repetition must not release. Only the id shows it: each repetition has a deadline of its own,
an operator's time is measured again after a restart, and a stop that was restored has no time.
"""

from collections import deque
from collections.abc import Callable
from pathlib import Path
from typing import Final, NamedTuple

from protocol.wire.codec import decode
from protocol.wire.enums import Command, Severity
from protocol.wire.messages import CommandRequest
from robot.file_writer import Directory, StateFile, text_in
from runtime import files
from runtime.errors import RemoteError
from runtime.units import NS_PER_S

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


NAME: Final = "stop"
ENDING: Final = ".txt"
TEXT: Final = "The emergency stop holds until an operator clears it.\n"
CLEARED: Final = "cleared"
MAX_CLEARED: Final = 16
RETRY_NS: Final = NS_PER_S
SAVED: Final = "emergency stop saved: it holds over a restart"
RESTORED: Final = "the emergency stop of the previous run still holds: clear it to arm"


class KeptStop:
    """Whether the stop is latched, in a file of the directory, or of `folder` if one is given.

    Without both nothing is kept.
    """

    def __init__(self, directory: Directory, folder: Path | None = None) -> None:
        self._file = directory.file(NAME, ENDING, folder)
        self._cleared = directory.file(CLEARED, ENDING, folder)
        self._ids: list[int] = []
        self._tried_ns = 0
        self._told = ""

    def found(self) -> bool:
        """Return whether an earlier run has left a stop; one that cannot be looked up counts."""
        if self._file is None or self._cleared is None:
            return False
        self._ids = ids_in(self._cleared.path)
        try:
            is_there = files.is_there(self._file.path)
        except OSError:
            return True
        self._file.found(TEXT if is_there else None)
        return is_there

    def was_cleared_by(self, request_id: int) -> bool:
        """Return whether this request has already released a stop, perhaps in an earlier run."""
        return request_id in self._ids

    def clear(self, request_id: int) -> None:
        """Remove the file of a stop that this request has released, and note the request first."""
        if self._cleared is not None:
            self._ids = [*self._ids, request_id][-MAX_CLEARED:]
            self._cleared.put("".join(f"{one:x}\n" for one in self._ids))
        self.keep(stopped=False)

    def keep(self, *, stopped: bool) -> None:
        """Write the file, or remove it."""
        self._told = ""
        if self._file is not None:
            self._file.put(TEXT if stopped else None)

    def retry(self, now_ns: int) -> None:
        """Repeat a write that has failed, about once a second."""
        file = self._file
        if file is not None and file.has_failed and now_ns - self._tried_ns >= RETRY_NS:
            self._tried_ns = now_ns
            file.put(TEXT if file.is_wanted else None)

    def news_of(self, file: StateFile) -> tuple[Severity, str] | None:
        """Return what operators should know about a write of the stop that has ended.

        The removal of a file is no news, nor is a repetition that fails like the write before.
        """
        words = "" if file.error is None else file.error.strerror or str(file.error)
        told, self._told = self._told, words
        if words:
            if words == told:
                return None
            if file.is_wanted:
                return Severity.CRITICAL, f"emergency stop NOT saved, trying again: {words}"
            return Severity.ERROR, f"{file.path} not removed, trying again: {words}"
        is_kept = file.is_wanted and file.on_disk is not None
        return (Severity.NOTICE, SAVED) if is_kept else None

    def is_of(self, file: StateFile) -> bool:
        """Return whether this is the file of the stop."""
        return file is self._file


def ids_in(path: Path) -> list[int]:
    """Return the ids that an earlier run has noted; none if they cannot be read."""
    try:
        return [int(line, 16) for line in text_in(path).splitlines()]
    except (OSError, ValueError):
        return []
