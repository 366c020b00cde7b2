"""Serial endpoint: `serial:DEVICE:BAUD`, one client, 8 data bits, no parity, 1 stop bit."""

import errno
import fcntl
import os
import termios
from collections.abc import Collection
from contextlib import suppress
from typing import Final

from gateways.mavlink.endpoints.endpoint import Received
from gateways.mavlink.endpoints.send_buffer import SendBuffer
from runtime.errors import UserError
from runtime.units import NS_PER_S

BITS_PER_BYTE: Final = 10
SHARE: Final = 5 / 6
"""The part of the line that is used: a radio adds bytes of its own."""
MAX_READ: Final = 4_096
REOPEN_NS: Final = NS_PER_S
STREAMS_WAIT_S: Final = 0.1
SPEEDS: Final = {
    int(name[1:]): value
    for name, value in vars(termios).items()
    if name[0] == "B" and name[1:].isdecimal() and int(name[1:]) > 0
}
"""The speeds that this system supports, with their codes."""
ADVICE: Final = {
    errno.ENOENT: "no such device: list them with `ls /dev/tty* /dev/serial/by-id`",
    errno.ENXIO: "no such device: list them with `ls /dev/tty* /dev/serial/by-id`",
    errno.EACCES: "missing rights: join the group `dialout`, then log in again",
    errno.EBUSY: "another process uses this line: end it",
    errno.ENOTTY: "this file is not a serial line",
}


class SerialEndpoint:
    """A serial line. It is opened again if it is lost, for example if the adapter is unplugged."""

    is_reliable = False

    def __init__(self, text: str, device: str, baud: int) -> None:
        self.text = text
        self.line_bytes_s = round(baud / BITS_PER_BYTE * SHARE)
        self._device, self._baud = device, baud
        self._descriptor: int | None = None
        self._tried_ns = 0
        self._gone: list[str] = []
        if baud not in SPEEDS:
            usual = "9600, 57600, 115200 or 921600"
            raise UserError(f"{text}: {baud} baud is not possible here: give {usual}")
        try:
            self._open()
        except (OSError, termios.error) as error:
            number = error.args[0] if error.args else 0
            why = ADVICE.get(number, str(error))
            raise UserError(f"{text}: {why}") from error

    def _open(self) -> None:
        descriptor = os.open(self._device, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        try:
            speed = SPEEDS[self._baud]
            *_, characters = termios.tcgetattr(descriptor)
            control = termios.CS8 | termios.CREAD | termios.CLOCAL
            raw = [0, 0, control, 0, speed, speed, characters]
            termios.tcsetattr(descriptor, termios.TCSANOW, raw)
            fcntl.ioctl(descriptor, termios.TIOCEXCL)
        except BaseException:
            os.close(descriptor)
            raise
        waiting = round(self.line_bytes_s * STREAMS_WAIT_S)
        self._buffer = SendBuffer(lambda data: os.write(descriptor, data), waiting)
        self._descriptor = descriptor

    def filenos(self) -> list[int]:
        """Return the descriptor, unless the line is lost."""
        return [] if self._descriptor is None else [self._descriptor]

    def lasting(self) -> Collection[str]:
        """Return the only peer, unless the line is lost."""
        return () if self._descriptor is None else (self._device,)

    def gone(self) -> list[str]:
        """Return the peer if the line has been lost since the last call."""
        gone, self._gone = self._gone, []
        return gone

    def receive(self) -> list[Received]:
        """Return the bytes that have arrived.

        A line may be a radio, so its client counts as another machine.
        """
        if self._descriptor is None:
            return []
        try:
            data = os.read(self._descriptor, MAX_READ)
        except BlockingIOError:
            return []
        except OSError:
            data = b""
        if not data:
            self._lose()
            return []
        return [Received(self._device, data, is_loopback=False)]

    def send(self, peer: str, data: bytes, *, is_stream: bool) -> None:
        """Send a frame, or keep it if the line is full, or drop it."""
        if self._descriptor is None:
            return
        try:
            self._buffer.add(data, is_stream=is_stream)
        except OSError:
            self._lose()

    def flush(self, now_ns: int) -> None:
        """Send the waiting frames; once per second, try to open a lost line again."""
        if self._descriptor is None:
            if now_ns - self._tried_ns >= REOPEN_NS:
                self._tried_ns = now_ns
                with suppress(OSError, termios.error):
                    self._open()
            return
        try:
            self._buffer.flush()
        except OSError:
            self._lose()

    def forget(self, peer: str) -> None:
        """Do nothing: the line stays."""

    def close(self) -> None:
        """Close the line."""
        if self._descriptor is not None:
            os.close(self._descriptor)
            self._descriptor = None

    def _lose(self) -> None:
        self.close()
        self._gone.append(self._device)
