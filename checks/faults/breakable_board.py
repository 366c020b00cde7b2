"""An emulated board in the place of the core, and the ways in which a fault matrix breaks it."""

import errno
import os
import re
import signal
import socket
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from random import Random
from tempfile import TemporaryDirectory
from time import monotonic
from typing import Final, Self

from checks.faults.cases import BoardFault
from firmware.board import RESTART, Board, Emulator, SerialLine
from firmware.host import BoardCore
from firmware.image import IMAGE
from protocol.wire.messages import BoardRestart
from robot.core.parameters import Params
from robot.core.values import Pose
from runtime.errors import RemoteError

MAX_GARBAGE: Final = 40
DEBUGGER_S: Final = 5.0
PROGRAM_COUNTER: Final = slice(15 * 8, 16 * 8)
"""Hexadecimal digits of register 15 among all registers."""
BRANCH_TO_ITSELF: Final = "fee7"
PACKET: Final = re.compile(rb"\$([^#]*)#..")
STOP_REPLY: Final = "T"
READ_BYTES: Final = 4096


class FaultyLine(SerialLine):
    """A serial line that may have a fault; `fault` is None while it is whole."""

    def __init__(self, line: SerialLine, random: Random) -> None:
        self.fault: BoardFault | None = None
        self._line, self._random = line, random
        self._garbage = b""

    def read(self, wait_s: float) -> bytes | None:
        """Return the bytes that have arrived, as `SerialLine` does."""
        if self.fault is BoardFault.CUT:
            return None
        if self.fault is not BoardFault.OUTPUT_LOST:
            garbage, self._garbage = self._garbage, b""
            return garbage or self._line.read(wait_s)
        until_s = monotonic() + wait_s
        while (left_s := until_s - monotonic()) > 0.0:
            self._line.read(left_s)
        return b""

    def write(self, data: bytes) -> None:
        """Write bytes, with garbage before them if that is the fault."""
        if self.fault is BoardFault.CUT:
            raise BrokenPipeError(errno.EPIPE, "cut")
        if self.fault is BoardFault.GARBAGE:
            self._line.write(self._bytes())
            self._garbage = self._bytes()
        if self.fault is not BoardFault.INPUT_LOST:
            self._line.write(data)

    def _bytes(self) -> bytes:
        return self._random.randbytes(self._random.randrange(MAX_GARBAGE))

    def close(self) -> None:
        """Close nothing: the line belongs to its emulator."""


class BreakableBoard:
    """Starts an emulated board for each core that is created; faults concern the newest."""

    def __init__(self, random: Random) -> None:
        self._random = random
        self._scope = ExitStack()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._scope.close()

    def new_core(self, params: Params, start: Pose, totals: tuple[int, int]) -> BoardCore:
        """Return a core on a new board; the one before is switched off."""
        self._scope.close()
        folder = Path(self._scope.enter_context(TemporaryDirectory(prefix="sidestep-debugger-")))
        self._debugger = folder / "gdb"
        debugger = f"socket,id=gdb,path={self._debugger},server=on,wait=off"
        options = ("-chardev", debugger, "-gdb", "chardev:gdb")
        self._emulator = self._scope.enter_context(Emulator(IMAGE.elf, extra=options))
        self._line = FaultyLine(self._emulator.line, self._random)
        self._board = Board(self._line)
        self._board.wait_for_hello()
        return BoardCore(self._board, params, start, totals)

    def inject(self, fault: BoardFault) -> None:
        """Inject a fault into the board or its line."""
        match fault:
            case BoardFault.HANG:
                hang(self._debugger)
            case BoardFault.SUSPEND:
                os.kill(self._emulator.pid, signal.SIGSTOP)
            case BoardFault.KILL:
                os.kill(self._emulator.pid, signal.SIGKILL)
            case BoardFault.RESET:
                self._board.send(BoardRestart(confirmation=RESTART))
            case _:
                self._line.fault = fault


def hang(path: Path) -> None:
    """Overwrite the next instruction with a branch to itself, as a debugger can."""
    with debugging(path) as ask:
        counter = int.from_bytes(bytes.fromhex(ask("g")[PROGRAM_COUNTER]), "little")
        ask(f"M{counter:x},2:{BRANCH_TO_ITSELF}")


@contextmanager
def debugging(path: Path) -> Iterator["Debugger"]:
    """Halt an emulator by its debugger interface; let it continue afterwards."""
    with socket.socket(socket.AF_UNIX) as line:
        line.settimeout(DEBUGGER_S)
        line.connect(str(path))
        debugger = Debugger(line)
        yield debugger
        debugger.order("D")


class Debugger:
    """The remote protocol of GDB: one packet out, one packet in; stop replies are skipped."""

    def __init__(self, line: socket.socket) -> None:
        self._line = line
        self._received = b""

    def __call__(self, packet: str) -> str:
        """Send a packet and return the contents of the answer."""
        self.order(packet)
        while (answer := self._packet()).startswith(STOP_REPLY):
            pass
        return answer

    def _packet(self) -> str:
        """Return the contents of the next packet, and acknowledge it."""
        while (found := PACKET.search(self._received)) is None:
            data = self._line.recv(READ_BYTES)
            if not data:
                raise RemoteError("the debugger interface of the emulator has closed")
            self._received += data
        self._received = self._received[found.end() :]
        self._line.sendall(b"+")
        return found[1].decode()

    def order(self, packet: str) -> None:
        """Send a packet."""
        body = packet.encode()
        self._line.sendall(b"$" + body + b"#" + f"{sum(body) & 0xFF:02x}".encode())
