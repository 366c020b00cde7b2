"""A shell for the commands of one page: a folder, a network, processes in the background."""

import fcntl
import os
import signal
import socket
import struct
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Final

from tests.support.docs.console import Command, File, Step, Stop, matches
from tests.support.until import until

ROOT: Final = Path(__file__).resolve().parents[3]
PATIENCE_S: Final = 60.0
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


class Session:
    """Runs the steps of a page in a folder; processes in the background end with it."""

    def __init__(self, folder: Path, prefix: Sequence[str]) -> None:
        self._folder = folder
        self._prefix = tuple(prefix)
        self._background: list[subprocess.Popen[bytes]] = []
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
        """Do one step. Return the printed lines of a command, None for other steps."""
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
        while self._background:
            process = self._background.pop()
            os.killpg(process.pid, signal.SIGINT)
            process.wait(PATIENCE_S)

    def _words(self, command: Command) -> tuple[str, ...]:
        return (*self._prefix, "bash", "-c", command.words)

    def _start(self, command: Command) -> list[str]:
        log = self._folder / f".{command.line}.log"
        with log.open("wb") as output:
            self._background.append(
                subprocess.Popen(
                    self._words(command),
                    cwd=self._folder,
                    env=self._environment,
                    stdout=output,
                    stderr=subprocess.STDOUT,
                    stdin=subprocess.DEVNULL,
                    start_new_session=True,
                )
            )
        process = self._background[-1]

        def printed() -> list[str]:
            return log.read_text(encoding="utf-8").splitlines()

        until(
            lambda: (
                matches(command.output, printed()[: len(command.output)])
                or process.poll() is not None
            ),
            PATIENCE_S,
        )
        return printed()[: len(command.output)]

    def _call(self, command: Command) -> list[str]:
        done = subprocess.run(
            self._words(command),
            cwd=self._folder,
            env=self._environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            stdin=subprocess.DEVNULL,
            text=True,
            timeout=PATIENCE_S,
            check=False,
        )
        assert done.returncode == command.exit_code, f"{command.words}\n{done.stdout}"
        return done.stdout.splitlines()

    def _repeat(self, command: Command) -> list[str]:
        printed: list[str] = []

        def is_expected() -> bool:
            printed[:] = self._call(command)
            return matches(command.output, printed)

        until(is_expected, PATIENCE_S)
        return printed


@contextmanager
def session(folder: Path) -> Iterator[Session]:
    """Yield a session in a folder, with a network of its own where that is allowed."""
    with ExitStack() as stack:
        found = Session(folder, stack.enter_context(private_network()))
        stack.callback(found.stop)
        yield found
