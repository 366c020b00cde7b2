"""Start, check and stop a set of child processes."""

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
from runtime.watchdog import Patience, slowdown_in

LAST_LINES: Final = 5
TAIL_BYTES: Final = 4000
FIRST_BYTES: Final = 4000
MAX_OUTPUT: Final = 4 << 20
"""Largest size of a child's output file; beyond it the file is truncated."""
LATE_EXIT_NS: Final = 300_000_000
POLL_NS: Final = 10_000_000
TERMINATING_SIGNALS: Final = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
STOP_STEPS: Final[tuple[tuple[int, int], ...]] = (
    (signal.SIGINT, 800_000_000),
    (signal.SIGTERM, 300_000_000),
    (signal.SIGKILL, 10_000_000_000),
)
"""Each signal and the nanoseconds until the next one, which count less while the machine is busy.
`up` promises to end within two seconds on an idle machine, and needs some for its own end. A child
that is killed ends at once, but for a disk that does not answer or a processor it has to wait for:
to leave before would leave it behind."""


class ChildExitError(RemoteError):
    """A child process exited unexpectedly; the message ends with its last output."""

    def __init__(self, why: str, exit_code: int) -> None:
        super().__init__(why)
        self.exit_code = exit_code


class ChildExit(NamedTuple):
    """Exit code and last output of a child that exited."""

    role: str
    code: int
    words: str


class Child(NamedTuple):
    """A running child process and the file with its output."""

    role: str
    process: subprocess.Popen[bytes]
    output: IO[bytes]

    def last_lines(self) -> str:
        """Return the last lines of the child's output."""
        size = self.output.seek(0, os.SEEK_END)
        self.output.seek(max(0, size - TAIL_BYTES))
        lines = self.output.read().decode(errors="replace").splitlines()
        return "\n".join(f"  {line}" for line in lines[-LAST_LINES:])

    def first_output(self) -> str:
        """Return the beginning of the child's output; empty if another thread has ended it.

        Parent and child share the file offset, which must not move.
        """
        try:
            return os.pread(self.output.fileno(), FIRST_BYTES, 0).decode(errors="replace")
        except ValueError:  # the file is closed
            return ""

    def trim(self) -> None:
        """Truncate the output file when it is too large; children may run for months.

        Parent and child share the file offset, so the child continues at the beginning.
        """
        number = self.output.fileno()
        if os.fstat(number).st_size > MAX_OUTPUT:
            os.lseek(number, 0, os.SEEK_SET)
            os.ftruncate(number, 0)


class Children:
    """The child processes of `up`. All of them are ended when the context is left."""

    def __init__(
        self,
        clock: Clock,
        command_of: Callable[[Sequence[str], int], list[str]] = command,
    ) -> None:
        self._clock = clock
        self._command_of = command_of
        self._children: list[Child] = []

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    def start(self, role: str, arguments: Sequence[str]) -> None:
        """Start a child in its own session, so Ctrl-C in the terminal reaches the parent only."""
        output = tempfile.TemporaryFile()  # noqa: SIM115 - closed when the child has been ended
        with defer_signals():  # a signal before the append would leave an orphan
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
        """Process ids of the children."""
        return [child.process.pid for child in self._children]

    @property
    def roles(self) -> list[str]:
        """Roles of the children."""
        return [child.role for child in self._children]

    def snapshot(self) -> tuple[Child, ...]:
        """Return the children that have not been ended."""
        return tuple(self._children)

    def send(self, role: str, number: int) -> bool:
        """Send a signal to a child; return False if it is not running."""
        for child in self._children:
            if child.role == role and child.process.poll() is None:
                child.process.send_signal(number)
                return True
        return False

    def end(self, roles: Sequence[str], within_ns: int) -> bool:
        """Interrupt some children; return whether all of them have exited in this time."""
        ending = [child for child in self._children if child.role in roles]
        for child in ending:
            child.process.send_signal(signal.SIGINT)
        return self._wait_for_exit(within_ns, ending)

    def take_exited(self) -> list[ChildExit]:
        """Remove and return the children that have exited since the last call."""
        found = []
        for child in tuple(self._children):
            code = child.process.poll()
            if code is not None:
                found.append(ChildExit(child.role, code, child.last_lines()))
                self._children.remove(child)
                child.output.close()
            else:
                child.trim()
        return found

    def check_for_late_exit(self) -> None:
        """Raise ChildExitError if a child has exited or exits within LATE_EXIT_NS."""
        patience = Patience(LATE_EXIT_NS, self._clock.now_ns, slowdown_in(self._clock))
        while patience.left_ns():
            self.check()
            self._clock.sleep_until(self._clock.now_ns() + POLL_NS)

    def check(self) -> None:
        """Raise ChildExitError for the first child that has exited."""
        for child in self._children:
            code = child.process.poll()
            if code is not None:
                words = child.last_lines()
                why = f"the {child.role} process exited unexpectedly ({exit_description(code)})"
                raise ChildExitError(f"{why}:\n{words}" if words else why, 2 if code == 2 else 1)
            child.trim()

    def stop(self) -> None:
        """End all children within two seconds, or up to five times that on a busy machine.

        A child that is killed cannot close its files. Ignore SIGINT and SIGTERM meanwhile.
        """
        ends: tuple[int, ...] = (signal.SIGINT, signal.SIGTERM)
        before = [(number, signal.getsignal(number)) for number in ends]
        for number, _ in before:
            signal.signal(number, signal.SIG_IGN)
        try:
            for number, grace_ns in STOP_STEPS:
                self._send(number)
                if self._wait_for_exit(grace_ns, self._children):
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

    def _wait_for_exit(self, grace_ns: int, children: Sequence[Child]) -> bool:
        patience = Patience(grace_ns, self._clock.now_ns, slowdown_in(self._clock))
        while any(child.process.poll() is None for child in children):
            if not patience.left_ns():
                return False
            self._clock.sleep_until(self._clock.now_ns() + POLL_NS)
        return True


@contextmanager
def defer_signals() -> Iterator[None]:
    """Defer terminating signals until the block is left; then deliver the first one."""
    caught: list[int] = []

    def catch(number: int, frame: FrameType | None) -> None:
        caught.append(number)

    before = {number: signal.signal(number, catch) for number in TERMINATING_SIGNALS}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
        for first in caught[:1]:
            signal.raise_signal(first)


def exit_description(code: int) -> str:
    """Describe the exit code of a process; a negative one is a signal number."""
    return f"signal {signal.Signals(-code).name}" if code < 0 else f"exit code {code}"
