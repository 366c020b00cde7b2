"""The process of a hosted board: the firmware's main loop with a module `board` made of a socket.

It runs the Python sources of the firmware, not its frozen code, and has no limits of memory. Its
clock is that of this machine.
"""

import os
import runpy
import socket
import sys
from pathlib import Path
from time import monotonic_ns
from types import ModuleType
from typing import Final

from firmware import build
from firmware.board import FrameStream
from firmware.image import core_hash, core_version
from protocol.wire.codec import HEADER_SIZE, WIRE_OF_ID, Encoder
from protocol.wire.message import Message

ONBOARD: Final = Path(build.__file__).with_name("onboard")
PAYLOAD_BYTES: Final = 255
NS_PER_CLOCK: Final = 40
CLOCK_MASK: Final = 0x3FFFFFFF
OTHER_CORE: Final = "other-core"
HANG: Final = b"hang"
"""Bytes outside of frames by which a test lets the board hang."""


class HostedBoard(ModuleType):
    """The module `board`, as board_module.c has it."""

    HEAP_BYTES = 48 * 1024
    FLOAT_BITS = 64

    def __init__(self, line: socket.socket, core: bytes, cause: int) -> None:
        super().__init__("board")
        self.inbox, self.outbox = bytearray(PAYLOAD_BYTES), bytearray(PAYLOAD_BYTES)
        self.CORE_HASH, self.CORE_VERSION = core, core_version().encode()
        self._line, self._cause = line, cause
        self._stream = FrameStream()
        self._arrived: list[Message] = []
        self._encoder = Encoder(1, 1)

    def receive(self, ms: int) -> int:
        """Return the id of the next frame, whose payload is then in `inbox`; 0 if none comes."""
        if not self._arrived:
            self._line.settimeout(max(ms, 1) / 1000.0)
            try:
                received = self._line.recv(4096)
            except TimeoutError:
                return 0
            if not received:
                sys.exit(0)
            while HANG in received:
                pass
            self._arrived.extend(self._stream.feed(received))
            if not self._arrived:
                return 0
        frame = self._encoder.encode(self._arrived.pop(0))
        self.inbox[:] = frame[HEADER_SIZE:-2].ljust(PAYLOAD_BYTES, b"\0")
        return int.from_bytes(frame[7:10], "little")

    def send(self, message_id: int, size: int) -> bool:
        """Send the payload in `outbox`."""
        message = WIRE_OF_ID[message_id].unpack(bytes(self.outbox[:size]))
        self._line.setblocking(True)
        self._line.sendall(self._encoder.encode(message))
        return True

    def clock(self) -> int:
        """Return the time in units of 40 ns."""
        return monotonic_ns() // NS_PER_CLOCK & CLOCK_MASK

    def skipped(self) -> int:
        """Return the number of bytes that belong to no frame."""
        return self._stream.skipped

    def reset_cause(self) -> int:
        """Return the cause of the last reset."""
        return self._cause

    def restart(self) -> None:
        """Start afresh, as after a reset from outside."""
        os.execv(sys.executable, [sys.executable, "-m", __spec__.name, *sys.argv[1:2], "", "1"])

    def settle(self) -> None:
        """Keep what is loaded for ever: Python does so by itself."""

    def _nothing(self) -> int:
        return 0

    heap_used = busy = refused = unsent = stack_peak = stack_bytes = static_bytes = flash_bytes = (
        _nothing
    )


def main(descriptor: str, which: str = "", cause: str = "0") -> None:
    """Serve a line for ever."""
    line = socket.socket(fileno=int(descriptor))
    os.set_inheritable(line.fileno(), True)
    core = bytes(32) if which == OTHER_CORE else core_hash()
    sys.modules["board"] = HostedBoard(line, core, int(cause))
    wire = sys.modules["wire"] = ModuleType("wire")
    exec(build.python_module(), vars(wire))
    sys.path.insert(0, str(ONBOARD))
    try:
        runpy.run_path(str(ONBOARD / "main.py"))
    except (BrokenPipeError, ConnectionResetError):
        sys.exit(0)


if __name__ == "__main__":
    main(*sys.argv[1:])
