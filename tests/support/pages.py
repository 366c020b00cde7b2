"""Commands on pages of the documentation: read, run in a shell, and compared."""

import fcntl
import os
import re
import signal
import socket
import struct
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Final, NamedTuple

from checks.harness.until import until

FENCE: Final = re.compile(r"^(?P<indent> *)```(?P<language>\w*)(?: title=\"(?P<title>[^\"]+)\")?$")
DIRECTIVE: Final = re.compile(r"^ *<!-- console: (?P<words>.+?) -->$")
NUMBER: Final = re.compile(r"[-+]?\d+(?:[.,]\d+)*(?:e[-+]?\d+)?")
PROMPT: Final = "$ "
CONTINUED: Final = "\\"
ANYTHING: Final = "..."
TRIES: Final = ("try", "tries")
"""Their number may be another one."""
REPLACED: Final = 2
SHIFTED: Final = 3
"""Costs of a changed line, and of a missing or additional one, when output is renewed."""


@dataclass(frozen=True, slots=True)
class File:
    """A file that the page asks the reader to save."""

    name: str
    text: str


@dataclass(frozen=True, slots=True)
class Command:
    """A command line, the output that the page shows, and how to run it."""

    line: int
    words: str
    output: tuple[str, ...]
    directive: str = ""

    @property
    def exit_code(self) -> int:
        """The expected exit code."""
        kind, _, code = self.directive.partition(" ")
        return int(code) if kind == "exit" else 0

    @property
    def runner(self) -> str | None:
        """The file that runs this command instead, or None."""
        before, found, file = self.directive.partition("run by ")
        return file if found and not before else None

    @property
    def is_exact(self) -> bool:
        """Return whether numbers must be equal."""
        return self.directive == "exact"


@dataclass(frozen=True, slots=True)
class Stop:
    """An order to end the processes in the background."""


Step = File | Command | Stop


def steps_of(page: Path) -> list[Step]:
    """Return what a page asks the reader to do, in order."""
    return list(steps(page.read_text(encoding="utf-8").splitlines()))


def steps(lines: Sequence[str]) -> Iterator[Step]:
    """Yield the files and commands of a page."""
    directive, number = "", 0
    while number < len(lines):
        if found := DIRECTIVE.match(lines[number]):
            directive = found["words"]
            if directive == "stop":
                directive = ""
                yield Stop()
        elif fence := FENCE.match(lines[number]):
            indent = len(fence["indent"])
            body = []
            for line in lines[number + 1 :]:
                if line[indent:] == "```":
                    break
                body.append(line[indent:])
            if fence["title"] is not None:
                yield File(fence["title"], "\n".join(body) + "\n")
            elif fence["language"] == "console":
                yield from commands(body, number + 2, directive)
            directive = ""
            number += len(body) + 1
        number += 1


def commands(body: Sequence[str], first_line: int, directive: str) -> Iterator[Command]:
    """Yield the commands of one block."""
    starts = [index for index, line in enumerate(body) if line.startswith(PROMPT)]
    for start, end in zip(starts, [*starts[1:], len(body)], strict=True):
        words, index = body[start].removeprefix(PROMPT), start
        while words.endswith(CONTINUED) and index + 1 < end:
            index += 1
            words = words.removesuffix(CONTINUED) + body[index].strip()
        yield Command(first_line + start, words, tuple(body[index + 1 : end]), directive)


def pattern_of(line: str, *, is_exact: bool = False) -> str:
    """Return the regular expression of one expected line."""
    parts = []
    for part in re.split(r"(\.\.\.|\s+)", line.strip()):
        if part == ANYTHING:
            parts.append(".*")
        elif part.isspace():
            parts.append(r"\s+")
        elif is_exact:
            parts.append(re.escape(part))
        elif part in TRIES:
            parts.append(f"(?:{'|'.join(TRIES)})")
        else:
            parts.append(re.sub(r"\0", lambda _: NUMBER.pattern, re.escape(NUMBER.sub("\0", part))))
    return "".join(parts)


def matches(expected: Sequence[str], printed: Sequence[str], *, is_exact: bool = False) -> bool:
    """Return whether the printed lines are the expected ones; blank lines do not count."""
    wanted = [line for line in expected if line.strip()]
    found = [line.strip() for line in printed if line.strip()]
    whole = "".join(
        r"(?:.*\n)*" if line.strip() == ANYTHING else pattern_of(line, is_exact=is_exact) + r"\n"
        for line in wanted
    )
    return re.fullmatch(whole, "".join(f"{line}\n" for line in found)) is not None


def renewed(
    expected: Sequence[str], printed: Sequence[str], *, is_exact: bool = False
) -> list[str]:
    """Return lines that match the printed ones; expected lines stay wherever they match.

    A number that may differ and a line `...` therefore stay, and only what has changed differs.
    """
    if not any(line.strip() for line in expected):
        return [line.rstrip() for line in printed]
    found = [line.rstrip() for line in printed if line.strip()]
    # rest[j]: how the lines from here on become the printed ones from j on: the cost, the lines.
    rest = [(SHIFTED * (len(found) - j), tuple(found[j:])) for j in range(len(found) + 1)]
    for line in reversed(expected):
        pattern = re.compile(pattern_of(line, is_exact=is_exact))
        is_any = line.strip() == ANYTHING
        if is_any or not line.strip():
            here = [(cost, (line, *lines)) for cost, lines in rest]
        else:
            here = [(cost + SHIFTED, lines) for cost, lines in rest]
        for j in reversed(range(len(found) if line.strip() else 0)):
            (cost, lines), (next_cost, next_lines) = rest[j + 1], here[j + 1]
            if is_any:
                ways = [here[j], (next_cost, next_lines)]
            elif pattern.fullmatch(found[j].strip()):
                ways = [(cost, (line, *lines)), here[j]]
            else:
                ways = [(cost + REPLACED, (found[j], *lines)), here[j]]
            if not is_any:
                ways.append((next_cost + SHIFTED, (found[j], *next_lines)))
            here[j] = min(ways, key=lambda way: way[0])
        rest = here
    return list(rest[0][1])


ROOT: Final = Path(__file__).resolve().parents[2]
PAGES: Final = tuple(
    path for name in ("tutorial", "how-to") for path in sorted((ROOT / "docs" / name).glob("*.md"))
)
"""The pages whose commands are run."""
PATIENCE_S: Final = 120.0
AGAIN_S: Final = 0.5
"""A command that is repeated costs as much as a start of Python."""
SIOCGIFFLAGS, SIOCSIFFLAGS, IFF_UP = 0x8913, 0x8914, 1
HOLDER: Final = "from tests.support.pages import hold; hold()"


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
        program.write_text(f'#!/bin/sh\nexec {sys.executable} -m sidestep "$@"\n')
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

        with suppress(RuntimeError):
            until(
                lambda: matches(command.output, printed()) or running.process.poll() is not None,
                within_s=PATIENCE_S,
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

        with suppress(RuntimeError):
            until(is_expected, within_s=PATIENCE_S, poll_s=AGAIN_S)
        return printed


@contextmanager
def session(folder: Path) -> Iterator[Session]:
    """Yield a session in a folder, with a network of its own where that is allowed."""
    with ExitStack() as stack:
        found = Session(folder, stack.enter_context(private_network()))
        stack.callback(found.stop)
        yield found
