"""The emulated board: qemu as a child process, with its UART on two pipes."""

import ctypes
import os
import select
import shutil
import signal
import subprocess
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from time import monotonic
from types import TracebackType
from typing import Final, Self

from runtime.errors import UserError

QEMU: Final = "qemu-system-arm"
MACHINE: Final = "mps2-an385"
INSTRUCTION_SHIFT: Final = 5
"""32 ns: three cycles an instruction at 96 MHz, by which the board's own clock is realistic."""
PR_SET_PDEATHSIG: Final = 1
READ_BYTES: Final = 65_536
LOOK_S: Final = 0.25
"""Interval at which a wait checks that the emulator still runs."""


class SerialLine:
    """A line as two file descriptors, of which one is read and the other one written.

    `is_alive` returns whether the board at the other end still runs.
    """

    def __init__(self, reads: int, writes: int, is_alive: Callable[[], bool]) -> None:
        self._reads, self._writes = reads, writes
        self._is_alive = is_alive

    def read(self, wait_s: float) -> bytes | None:
        """Return the bytes that have arrived; nothing within this time: b"", line cut: None."""
        deadline = monotonic() + wait_s
        while True:
            left_s = max(0.0, deadline - monotonic())
            if select.select([self._reads], [], [], min(left_s, LOOK_S))[0]:
                return os.read(self._reads, READ_BYTES) or None
            if not self._is_alive():
                return None
            if left_s == 0.0:
                return b""

    def write(self, data: bytes) -> None:
        """Write bytes; raise OSError if the line is cut."""
        while data:
            data = data[os.write(self._writes, data) :]

    def close(self) -> None:
        """Cut the line."""
        os.close(self._reads)
        os.close(self._writes)


class Emulator:
    """A running qemu; `line` is the host's end of the serial line."""

    def __init__(self, image: Path, *, extra: Sequence[str] = (), log: Path | None = None) -> None:
        """Start qemu with an image; exceptions of the firmware are written to `log`."""
        if shutil.which(QEMU) is None:
            raise UserError(f"{QEMU} not found: apt install qemu-system-arm")
        if not image.exists():
            raise UserError(f"no firmware at {image}: build it with `make firmware`")
        self._folder = tempfile.TemporaryDirectory(prefix="sidestep-board-")
        pipes = [Path(self._folder.name) / f"line.{end}" for end in ("out", "in")]
        for pipe in pipes:
            os.mkfifo(pipe, mode=0o600)
        self._process = subprocess.Popen(
            command(image, pipes[0].with_suffix(""), log, extra),
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            preexec_fn=end_with_parent,
        )
        # Opened for both directions, so that this does not wait for qemu.
        reads, writes = (os.open(pipe, os.O_RDWR) for pipe in pipes)
        self.line = SerialLine(reads, writes, self.is_running)

    @property
    def pid(self) -> int:
        """Process id of qemu."""
        return self._process.pid

    def is_running(self) -> bool:
        """Return whether qemu still runs."""
        return self._process.poll() is None

    def failure(self) -> str:
        """Return the first line of the error output of a qemu that has ended; empty if it runs."""
        assert self._process.stderr is not None
        if self.is_running():
            return ""
        return self._process.stderr.read().decode(errors="replace").strip().partition("\n")[0]

    def terminate(self) -> None:
        """End qemu normally, so that a plugin writes its results."""
        self._process.terminate()
        self._process.wait()

    def kill(self) -> None:
        """End qemu at once, as if the board had lost its power."""
        self._process.kill()
        self._process.wait()

    def close(self) -> None:
        """End qemu and cut the line."""
        self.kill()
        self.line.close()
        if self._process.stderr is not None:
            self._process.stderr.close()
        self._folder.cleanup()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        at: TracebackType | None,
    ) -> None:
        self.close()


def command(image: Path, line: Path, log: Path | None, extra: Sequence[str]) -> list[str]:
    """Return the command line of qemu; `line` is the path of its pipes without their suffix."""
    return [
        QEMU,
        *("-machine", MACHINE),
        *("-display", "none"),
        *("-monitor", "none"),
        *("-icount", f"shift={INSTRUCTION_SHIFT}"),
        *("-kernel", str(image)),
        *("-chardev", f"pipe,id=line,path={line}"),
        *("-serial", "chardev:line"),
        *("-serial", "null" if log is None else f"file:{log}"),
        *extra,
    ]


def end_with_parent() -> None:
    """Let the kernel end this child when its parent ends."""
    ctypes.CDLL(None, use_errno=True).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
