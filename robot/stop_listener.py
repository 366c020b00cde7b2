"""Receive stop datagrams in a thread that does nothing else.

It needs neither the bus nor the loop: a stop sets the latch, which the loop reads first. Each press
is answered with what the loop has made of it, at its next repetition.
"""

import errno
import selectors
import socket
import sys
import time
from collections import OrderedDict
from collections.abc import Callable
from contextlib import suppress
from threading import Event, Thread
from typing import Any, Final, Protocol, Self

from protocol.bus.network import Network
from protocol.bus.sockets import SO_ATTACH_FILTER, attach, datagram_steps
from protocol.stop_datagram import (
    PRESS,
    PRESS_BYTES,
    Press,
    PressVerdict,
    StopJudge,
    operators_secrets,
    places,
    sealed_answer,
)
from runtime.errors import KeysError

BURST: Final = 64
PAUSE_S: Final = 0.005
"""After a burst the thread pauses, so that a flood costs the loop little of the interpreter."""

RECEIVE_BYTES: Final = 1 << 20
"""Room for a burst, of which the system permits a part: the thread reads on only after a pause."""

LACKING: Final = (errno.EADDRNOTAVAIL, errno.EAFNOSUPPORT)
MOST_PRESSES: Final = 1024
NOT_BEFORE: Final = (0, -1e9)
OLD_S: Final = 1.0
"""A copy that comes this long after its press is an old one: the network doubles at once."""

WAIT_S: Final = 0.2
QUIET_S: Final = 10.0
"""Least time between two reports about copies of old stops."""


class Stoppable(Protocol):
    """The part of the robot's process that the listener needs; both are thread-safe."""

    def press(self, operator: str, request_id: int) -> int:
        """Set the latch of the emergency stop; return the number of the press for `has_stopped`."""

    def has_stopped(self, press: int) -> bool:
        """Return whether the loop has acted on a press and the stop is latched."""

    def note(self, words: str) -> None:
        """Let the loop announce a warning."""


class StopListener:
    """Receives the stop datagrams of one robot until it is closed, best by `with`.

    `log` receives lines about what it does not do, such as an address that is in use.
    """

    def __init__(
        self,
        network: Network,
        robot: str,
        endpoints: tuple[str, ...],
        process: Stoppable,
        log: Callable[[str], None],
    ) -> None:
        self._process, self._log = process, log
        self._robot = robot
        self._presses: OrderedDict[tuple[str, int], tuple[int, float]] = OrderedDict()
        """The number and the time of the first press of each request, by operator and id."""

        self._replays, self._reported_s = 0, -QUIET_S
        self.places: list[tuple[str, int]] = []
        self._selector = selectors.DefaultSelector()
        self._closing = Event()
        self._thread = Thread(target=self._run, name="stop datagrams", daemon=True)
        secrets = None
        try:
            secrets = operators_secrets(network)
        except KeysError as error:
            log(f"stop datagrams are not received: {error}")
            return
        if secrets is not None and secrets.missing:
            log(f"stop datagrams are not received: {secrets.missing}")
            return
        self._judge = StopJudge(robot, None if secrets is None else secrets.by_name)
        wanted = places(network, robot, endpoints)
        if not wanted:
            log(f"stop datagrams are not received: give an address of {robot} with --stop-at")
        self.places = [place for place in wanted if self._bind(*place)]
        if self.places:
            self._thread.start()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """End the thread and close the sockets."""
        self._closing.set()
        if self._thread.is_alive():
            self._thread.join()
        for key in tuple(self._selector.get_map().values()):
            opened: Any = key.fileobj
            opened.close()
        self._selector.close()

    def _bind(self, host: str, port: int) -> bool:
        """Receive at all addresses of a place; return whether there is one."""
        try:
            found = socket.getaddrinfo(host, port, type=socket.SOCK_DGRAM)
        except (OSError, UnicodeError) as error:
            self._log(f"stop datagrams are not received at {host}:{port}: {error}")
            return False
        failures = [self._bind_one(family, address, port) for family, *_, address in found]
        is_bound = None in failures
        for failure in failures:  # a name may have an address of a kind that this system lacks
            if failure is not None and not (is_bound and failure.errno in LACKING):
                self._log(f"stop datagrams are not received at {host}:{port}: {failure.strerror}")
        return is_bound

    def _bind_one(self, family: int, address: Any, port: int) -> OSError | None:
        """Receive at one address; return why not, or None."""
        try:
            opened = socket.socket(family, socket.SOCK_DGRAM)
        except OSError as error:
            return error
        try:
            opened.setblocking(False)
            with suppress(OSError):
                opened.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, RECEIVE_BYTES)
            opened.bind(address)
            self._filter(opened, f"{address[0]}:{port}")
        except OSError as error:
            opened.close()
            return error
        self._selector.register(opened, selectors.EVENT_READ)
        return None

    def _filter(self, opened: socket.socket, place: str) -> None:
        """Let the kernel pass only what looks like a press.

        Other datagrams take neither room in the receive buffer nor time of the interpreter.
        """
        try:
            if sys.platform != "linux":
                raise OSError("this system has no packet filter for sockets")
            attach(opened, datagram_steps(PRESS_BYTES, PRESS), SO_ATTACH_FILTER)
        except OSError as error:
            why = error.strerror or error
            self._log(
                f"stop datagrams are received at {place} without a filter ({why}): a flood of "
                "other datagrams can keep them out"
            )

    def _run(self) -> None:
        while not self._closing.is_set():
            flooded = False
            for key, _ in self._selector.select(WAIT_S):
                opened: Any = key.fileobj
                flooded |= self._read(opened)
            if flooded:
                self._closing.wait(PAUSE_S)

    def _read(self, opened: socket.socket) -> bool:
        """Take what has arrived at a socket; return whether there may be more."""
        for _ in range(BURST):
            try:
                packet, sender = opened.recvfrom(PRESS_BYTES + 1)
            except BlockingIOError:
                return False
            except OSError:  # the error of an earlier answer
                continue
            try:
                answer = self.take(packet, str(sender[0]))
            except Exception as error:  # one packet must not end the way of all others
                self._process.note(f"a stop datagram failed: {error}")
                continue
            if answer is not None:
                with suppress(OSError):  # the sender repeats until it is answered
                    opened.sendto(answer, sender)
        return True

    def take(self, packet: bytes, sender: str) -> bytes | None:
        """Act on a packet; return the answer, None to one that is no stop for this robot."""
        verdict, press = self._judge.judge(packet)
        if press is None:
            return None
        request = press.operator, press.request_id
        number, since_s = before = self._presses.get(request, NOT_BEFORE)
        if verdict is PressVerdict.STOP:
            pressed = self._process.press(press.operator, press.request_id)
            if before is NOT_BEFORE:
                self._presses[request] = pressed, time.monotonic()
                if len(self._presses) > MOST_PRESSES:
                    self._presses.popitem(last=False)
        stopped = before is not NOT_BEFORE and self._process.has_stopped(number)
        is_old = time.monotonic() - since_s >= OLD_S
        if verdict is PressVerdict.REPLAY and not stopped and is_old:
            self._report_replay(press, sender)
        secret = self._judge.secret_of(press.operator) or b""
        return sealed_answer(secret, self._robot, press, stopped=stopped)

    def _report_replay(self, press: Press, sender: str) -> None:
        self._replays += 1
        now_s = time.monotonic()
        if now_s - self._reported_s < QUIET_S:
            return
        times = "once" if self._replays == 1 else f"{self._replays} times"
        self._process.note(
            f"an old stop datagram of {press.operator} came again {times} since the last report, "
            f"from {sender}: ignored, its stop was released"
        )
        self._replays, self._reported_s = 0, now_s
