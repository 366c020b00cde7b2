"""Child processes that are started together, watched together, and never left behind."""

import os
import signal
import subprocess
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from types import FrameType
from typing import IO, Final, NamedTuple, Self

from ground.launch.child_command import command
from runtime.clock import Clock
from runtime.errors import RemoteError

LAST_LINES: Final = 5
TAIL_BYTES: Final = 4000
MAX_OUTPUT: Final = 4 << 20
"""Bytes that a child may have written before its file is begun anew."""
BLAME_NS: Final = 300_000_000
PAUSE_NS: Final = 10_000_000
ENDS: Final = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
# Asked nicely, asked firmly, ended: two seconds in all.
STEPS: Final[tuple[tuple[int, int], ...]] = (
    (signal.SIGINT, 1_000_000_000),
    (signal.SIGTERM, 500_000_000),
    (signal.SIGKILL, 400_000_000),
)


class ChildDied(RemoteError):
    """A process of ours ended by itself: which, how, and its last words."""

    def __init__(self, why: str, exit_code: int) -> None:
        super().__init__(why)
        self.exit_code = exit_code


class Ended(NamedTuple):
    """One that has ended by itself: its exit code, and the end of what it wrote."""

    role: str
    code: int
    words: str


class Child(NamedTuple):
    role: str
    process: subprocess.Popen[bytes]
    output: IO[bytes]

    def last_words(self) -> str:
        """The end of what it wrote."""
        size = self.output.seek(0, os.SEEK_END)
        self.output.seek(max(0, size - TAIL_BYTES))
        lines = self.output.read().decode(errors="replace").splitlines()
        return "\n".join(f"  {line}" for line in lines[-LAST_LINES:])

    def trim(self) -> None:
        """Truncate the log of the child when it is too large; children may run for months.

        Parent and child share the place in the file, so the child goes on at the beginning.
        """
        number = self.output.fileno()
        if os.fstat(number).st_size > MAX_OUTPUT:
            os.lseek(number, 0, os.SEEK_SET)
            os.ftruncate(number, 0)


class Children:
    """Ends every child on the way out, whatever the way."""

    def __init__(
        self,
        clock: Clock,
        command_of: Callable[[Sequence[str], int], list[str]] = command,
        steps: Sequence[tuple[int, int]] = STEPS,
    ) -> None:
        self._clock = clock
        self._command_of = command_of
        self._steps = steps
        self._children: list[Child] = []

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    def start(self, role: str, arguments: Sequence[str]) -> None:
        """A session of its own: Ctrl-C in the terminal reaches us, and we end the children."""
        output = tempfile.TemporaryFile()  # noqa: SIM115 - closed when the child has been ended
        with held_back():  # a signal between its birth and its entry here would leave it behind
            process = subprocess.Popen(
                self._command_of(arguments, os.getpid()),
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=subprocess.STDOUT,
                start_new_session=True,
            )
            self._children.append(Child(role, process, output))

    @property
    def pids(self) -> list[int]:
        return [child.process.pid for child in self._children]

    @property
    def roles(self) -> list[str]:
        return [child.role for child in self._children]

    def send(self, role: str, number: int) -> bool:
        """A signal to one of them; False when it is not there."""
        for child in self._children:
            if child.role == role and child.process.poll() is None:
                child.process.send_signal(number)
                return True
        return False

    def ended(self) -> list[Ended]:
        """Those that have ended by themselves, each once: they are no children any more."""
        found = []
        for child in tuple(self._children):
            code = child.process.poll()
            if code is not None:
                found.append(Ended(child.role, code, child.last_words()))
                self._children.remove(child)
                child.output.close()
            else:
                child.trim()
        return found

    def blame(self) -> None:
        """A silence is to be explained: raise ChildDied if a child is gone or about to be."""
        deadline_ns = self._clock.now_ns() + BLAME_NS
        while self._clock.now_ns() < deadline_ns:
            self.check()
            self._clock.sleep_until(self._clock.now_ns() + PAUSE_NS)

    def check(self) -> None:
        """Raise ChildDied for the first child that has ended by itself."""
        for child in self._children:
            code = child.process.poll()
            if code is not None:
                words = child.last_words()
                why = f"the {child.role} process ended by itself ({how(code)})"
                raise ChildDied(f"{why}:\n{words}" if words else why, 2 if code == 2 else 1)
            child.trim()

    def stop(self) -> None:
        """End all of them within two seconds. Further signals must not cut this short."""
        ends: tuple[int, ...] = (signal.SIGINT, signal.SIGTERM)
        before = [(number, signal.getsignal(number)) for number in ends]
        for number, _ in before:
            signal.signal(number, signal.SIG_IGN)
        try:
            for number, patience_ns in self._steps:
                self._send(number)
                if self._gone(patience_ns):
                    break
            for child in self._children:
                child.output.close()
            self._children.clear()
        finally:
            for number, handler in before:
                signal.signal(number, handler)

    def _send(self, number: int) -> None:
        for child in self._children:
            if child.process.poll() is None:
                child.process.send_signal(number)

    def _gone(self, patience_ns: int) -> bool:
        deadline_ns = self._clock.now_ns() + patience_ns
        while any(child.process.poll() is None for child in self._children):
            if self._clock.now_ns() >= deadline_ns:
                return False
            self._clock.sleep_until(self._clock.now_ns() + PAUSE_NS)
        return True


@contextmanager
def held_back(numbers: Sequence[int] = ENDS) -> Iterator[None]:
    """Signals that end a process wait until the block is left, and then do what they always do."""
    caught: list[int] = []

    def catch(number: int, frame: FrameType | None) -> None:
        caught.append(number)

    before = {number: signal.signal(number, catch) for number in numbers}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
        for number in caught[:1]:
            signal.raise_signal(number)


def how(code: int) -> str:
    return f"signal {signal.Signals(-code).name}" if code < 0 else f"exit code {code}"
