"""A shell for the commands of one page: a folder, a network, processes in the background."""

import fcntl
import os
import signal
import socket
import struct
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Final, NamedTuple

from tests.support.docs.console import Command, File, Step, Stop, matches
from tests.support.until import until

ROOT: Final = Path(__file__).resolve().parents[3]
PAGES: Final = tuple(
    path for name in ("tutorial", "how-to") for path in sorted((ROOT / "docs" / name).glob("*.md"))
)
"""The pages whose commands are run."""
PATIENCE_S: Final = 120.0
AGAIN_S: Final = 0.5
"""A command that is repeated costs as much as a start of Python."""
SIOCGIFFLAGS, SIOCSIFFLAGS, IFF_UP = 0x8913, 0x8914, 1
HOLDER: Final = "from tests.support.docs.session import hold; hold()"


def hold() -> None:
    """Set the loopback interface of a new network up, and keep the network until input ends."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as control:
        request = struct.pack("16sh14x", b"lo", 0)
        flags = struct.unpack("16sh14x", fcntl.ioctl(control, SIOCGIFFLAGS, request))[1]
        fcntl.ioctl(control, SIOCSIFFLAGS, struct.pack("16sh14x", b"lo", flags | IFF_UP))
    print("up", flush=True)
    sys.stdin.read()


@contextmanager
def private_network() -> Iterator[tuple[str, ...]]:
    """Yield the words that run a command in a network of its own.

    Pages use the default port, which another process of this machine may have. Where the kernel
    allows no such network, yield no words.
    """
    as_user = () if os.geteuid() == 0 else ("-r",)
    words = ("unshare", *as_user, "-n", sys.executable, "-c", HOLDER)
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    pipe = subprocess.PIPE
    with subprocess.Popen(
        words, stdin=pipe, stdout=pipe, stderr=subprocess.DEVNULL, text=True, env=environment
    ) as holder:
        assert holder.stdout is not None
        into = ("nsenter", "--target", str(holder.pid), "--net")
        user = ("--user", "--preserve-credentials") if as_user else ()
        yield (*into, *user) if holder.stdout.readline() else ()
        assert holder.stdin is not None
        holder.stdin.close()


class CommandError(RuntimeError):
    """A command ended otherwise than its page says: the command, its output and its end."""

    def __init__(self, command: Command, printed: Sequence[str], end: str) -> None:
        super().__init__("\n".join((f"line {command.line}: $ {command.words}", *printed, end)))


class Running(NamedTuple):
    """The process of a command, which leads a group of its own, and the file of its output."""

    command: Command
    process: subprocess.Popen[bytes]
    log: Path

    def printed(self) -> list[str]:
        """Return the lines printed so far."""
        return self.log.read_text(encoding="utf-8", errors="replace").splitlines()

    def end(self, number: signal.Signals) -> None:
        """Send a signal to the group, and wait; raise CommandError if the process stays."""
        if self.process.poll() is None:
            os.killpg(self.process.pid, number)
        try:
            self.process.wait(PATIENCE_S)
        except subprocess.TimeoutExpired:
            os.killpg(self.process.pid, signal.SIGKILL)
            self.process.wait()
            raise self.error(f"not ended {PATIENCE_S:g} s after {number.name}") from None

    def error(self, end: str) -> CommandError:
        """Return the error of a command with this end."""
        return CommandError(self.command, self.printed(), end)


class Session:
    """Runs the steps of a page in a folder; processes in the background end with it."""

    def __init__(self, folder: Path, prefix: Sequence[str]) -> None:
        self._folder = folder
        self._prefix = tuple(prefix)
        self._background: list[Running] = []
        tools = folder / ".bin"
        tools.mkdir()
        program = tools / "sidestep"
        program.write_text(f'#!/bin/sh\nexec {sys.executable} {ROOT}/sidestep.py "$@"\n')
        program.chmod(0o755)
        self._environment = {
            **os.environ,
            "COLUMNS": "100",
            "HOME": str(folder),
            # The fonts that matplotlib has found need not be searched again.
            "XDG_CACHE_HOME": os.environ.get("XDG_CACHE_HOME", str(Path.home() / ".cache")),
            "PATH": f"{tools}:{Path(sys.executable).parent}:{os.environ['PATH']}",
            "PYTHONPATH": str(ROOT),
            "XDG_STATE_HOME": str(folder / ".state"),
            "XDG_CONFIG_HOME": str(folder / ".config"),
        }

    def run(self, step: Step) -> list[str] | None:
        """Do one step. Return the printed lines of a command, None for other steps.

        The lines may be others than those of the page. Raises CommandError if a command ends with
        another exit code, or not at all.
        """
        if isinstance(step, File):
            path = self._folder / step.name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(step.text, encoding="utf-8")
        elif isinstance(step, Stop):
            self.stop()
        elif step.directive == "background":
            return self._start(step)
        elif step.directive == "until":
            return self._repeat(step)
        elif step.runner is None:
            return self._call(step)
        return None

    def stop(self) -> None:
        """End the processes in the background, the last one first."""
        with ExitStack() as stack:
            for running in self._background:
                stack.callback(running.end, signal.SIGINT)
            self._background.clear()

    def _begin(self, command: Command) -> Running:
        log = self._folder / f".{command.line}.log"
        with log.open("wb") as output:
            process = subprocess.Popen(
                (*self._prefix, "bash", "-c", command.words),
                cwd=self._folder,
                env=self._environment,
                stdout=output,
                stderr=subprocess.STDOUT,
                stdin=subprocess.DEVNULL,
                start_new_session=True,
            )
        return Running(command, process, log)

    def _start(self, command: Command) -> list[str]:
        running = self._begin(command)
        self._background.append(running)

        def printed() -> list[str]:
            return running.printed()[: len(command.output)]

        with suppress(AssertionError):
            until(
                lambda: matches(command.output, printed()) or running.process.poll() is not None,
                PATIENCE_S,
            )
        lines = printed()
        if running.process.poll() and not matches(command.output, lines):
            raise running.error(f"exit code {running.process.returncode} in the background")
        return lines

    def _call(self, command: Command) -> list[str]:
        running = self._begin(command)
        try:
            code = running.process.wait(PATIENCE_S)
        except subprocess.TimeoutExpired:
            raise running.error(f"not ended within {PATIENCE_S:g} s") from None
        finally:
            running.end(signal.SIGKILL)
        if code != command.exit_code:
            raise running.error(f"exit code {code}, not {command.exit_code}")
        return running.printed()

    def _repeat(self, command: Command) -> list[str]:
        printed: list[str] = []

        def is_expected() -> bool:
            printed[:] = self._call(command)
            return matches(command.output, printed)

        with suppress(AssertionError):
            until(is_expected, PATIENCE_S, poll_s=AGAIN_S)
        return printed


@contextmanager
def session(folder: Path) -> Iterator[Session]:
    """Yield a session in a folder, with a network of its own where that is allowed."""
    with ExitStack() as stack:
        found = Session(folder, stack.enter_context(private_network()))
        stack.callback(found.stop)
        yield found
