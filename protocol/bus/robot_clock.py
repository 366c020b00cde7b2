"""Estimate of a robot's clock in a ground process, for deadlines and ages.

An estimate is never later than the robot's own time. A request therefore never stays valid longer
than its sender wanted, and a frame never looks newer than it is.
"""

import threading
from collections import deque
from collections.abc import Callable
from struct import Struct
from struct import error as struct_error
from typing import Final

from protocol.bus.mailbox import MAX_STAMP_NS

SAMPLES: Final = 8
EVERY_S: Final = 2.0
FIRST_S: Final = 0.1
"""Pause between attempts until the first answer."""

TIME: Final = Struct("<q")
"""A time on the robot's clock in ns, as attachments carry it."""


def time_bytes(time_ns: int) -> bytes:
    """Return an attachment that contains a time."""
    return TIME.pack(time_ns)


AGAIN: Final = b"again"
"""The end of the attachment of an event that a fresh session puts once more."""


def marked_again(attachment: bytes | None) -> bytes:
    """Return the attachment with which an event is put once more; a time in it stays."""
    return (attachment or b"") + AGAIN


def is_again(attachment: bytes) -> bool:
    """Return whether an attachment is that of an event which is put once more."""
    return attachment.endswith(AGAIN) and len(attachment) != TIME.size


def time_in(attachment: bytes) -> int | None:
    """Return the time in an attachment; None if it contains none."""
    try:
        stamp = attachment.removesuffix(AGAIN) if is_again(attachment) else attachment
        return int(TIME.unpack(stamp)[0])
    except struct_error:
        return None


class RobotClock:
    """Lower limit of one robot's clock offset to ours. May be used from any thread."""

    def __init__(self) -> None:
        self._ahead_ns: deque[int] = deque(maxlen=SAMPLES)

    def observe(self, asked_ns: int, robot_ns: int, answered_ns: int) -> None:
        """Add a measurement: `robot_ns` was read between our times `asked_ns` and `answered_ns`.

        Drop the earlier ones if the robot's clock has gone back since, as after a restart. Ignore
        an implausible time: sums with it could overflow the integer of the wire.
        """
        if abs(robot_ns) >= MAX_STAMP_NS:
            return
        ahead_ns = tuple(self._ahead_ns)  # another thread may clear the measurements meanwhile
        if ahead_ns and max(ahead_ns) > robot_ns - asked_ns:
            self._ahead_ns.clear()
        self._ahead_ns.append(robot_ns - answered_ns)

    def forget(self) -> None:
        """Drop all measurements, because the robot has contradicted them."""
        self._ahead_ns.clear()

    def time_ns(self, now_ns: int) -> int | None:
        """Return the robot's time at our time `now_ns`; None before the first measurement."""
        ahead_ns = tuple(self._ahead_ns)
        return now_ns + max(ahead_ns) if ahead_ns else None


class RobotClocks:
    """Clocks of all robots that a process commands, measured periodically in a thread.

    `measure` queries one robot's time and calls `observe`; it may wait, and returns whether the
    robot has answered.
    """

    def __init__(self, now_ns: Callable[[], int], measure: Callable[[str], bool]) -> None:
        self._now_ns = now_ns
        self._measure = measure
        self._clocks: dict[str, RobotClock] = {}
        self._followed: set[str] = set()
        self._wake = threading.Event()
        self._closed = False
        self._thread: threading.Thread | None = None

    def of(self, robot: str) -> RobotClock:
        """Return the clock of a robot."""
        return self._clocks.setdefault(robot, RobotClock())

    def time_ns(self, robot: str) -> int | None:
        """Return a robot's present time; None while it is unknown."""
        return self.of(robot).time_ns(self._now_ns())

    def follow(self, robot: str) -> None:
        """Measure this robot's clock periodically from now on."""
        self._followed.add(robot)
        if self._thread is None and not self._closed:
            self._thread = threading.Thread(target=self._run, name="robot clocks", daemon=True)
            self._thread.start()
        self._wake.set()

    def close(self) -> None:
        """End the measurements."""
        self._closed = True
        self._wake.set()
        if self._thread is not None:
            self._thread.join(timeout=1.0)

    def _run(self) -> None:
        while not self._closed:
            self._wake.clear()
            known = [self._measure(robot) for robot in tuple(self._followed) if not self._closed]
            if not self._closed:
                self._wake.wait(EVERY_S if all(known) else FIRST_S)
