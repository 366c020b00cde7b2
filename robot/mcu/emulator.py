"""The emulated board: qemu as a child process, with its UART on a socket."""

import ctypes
import os
import shutil
import signal
import socket
import subprocess
from collections.abc import Sequence
from pathlib import Path
from types import TracebackType
from typing import Final, Self

from runtime.errors import UserError

QEMU: Final = "qemu-system-arm"
MACHINE: Final = "mps2-an385"
NS_PER_INSTRUCTION_LOG2: Final = 5
"""32 ns: about three cycles an instruction at 96 MHz, so that the board's own clock is realistic."""
PR_SET_PDEATHSIG: Final = 1


class Emulator:
    """A running qemu; `line` is the host's end of the serial line."""

    def __init__(self, image: Path, *, extra: Sequence[str] = (), log: Path | None = None) -> None:
        """Start qemu with an image; exceptions of the firmware are written to `log`."""
        if shutil.which(QEMU) is None:
            raise UserError(f"{QEMU} not found: apt install qemu-system-arm")
        if not image.exists():
            raise UserError(f"no firmware at {image}: build it with `make firmware`")
        self.line, theirs = socket.socketpair()
        self.log = log
        arguments = command(image, theirs.fileno(), log, extra)
        self._process = subprocess.Popen(
            arguments,
            pass_fds=[theirs.fileno()],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            preexec_fn=end_with_parent,
        )
        theirs.close()

    @property
    def pid(self) -> int:
        """Process id of qemu."""
        return self._process.pid

    def is_running(self) -> bool:
        """Return whether qemu still runs."""
        return self._process.poll() is None

    def last_words(self) -> str:
        """Return what an ended qemu has written to its standard error."""
        assert self._process.stderr is not None
        return self._process.stderr.read().decode(errors="replace").strip()

    def close(self) -> None:
        """End qemu."""
        self.line.close()
        self._process.kill()
        self._process.wait()
        if self._process.stderr is not None:
            self._process.stderr.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None
    ) -> None:
        self.close()


def command(image: Path, line: int, log: Path | None, extra: Sequence[str]) -> list[str]:
    """Return the command line of qemu; `line` is the file descriptor of its serial line."""
    return [
        QEMU,
        *("-machine", MACHINE),
        *("-display", "none"),
        *("-monitor", "none"),
        *("-icount", f"shift={NS_PER_INSTRUCTION_LOG2}"),
        *("-kernel", str(image)),
        *("-chardev", f"socket,id=line,fd={line}"),
        *("-serial", "chardev:line"),
        *("-serial", "null" if log is None else f"file:{log}"),
        *extra,
    ]


def end_with_parent() -> None:
    """Let the kernel end this child when its parent ends."""
    ctypes.CDLL(None, use_errno=True).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)


def is_available() -> bool:
    """Return whether qemu is installed."""
    return shutil.which(QEMU, path=os.environ.get("PATH")) is not None
