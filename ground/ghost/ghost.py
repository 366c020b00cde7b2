"""Another navigator from an instant of a run, in a process of its own while nobody waits for it.

Make and start it in the thread that stays: Linux ends a child with the thread that started it.
"""

import os
import subprocess
import tempfile
import threading
from collections.abc import Callable, Mapping, Sequence
from contextlib import nullcontext, suppress
from types import MappingProxyType
from typing import IO, Final, Self

from ground.client.goal import Destination
from ground.ghost.branch_point import BranchPoint, Facts, trial_words, world_bytes
from ground.ghost.predicted_path import FAILED, PathReader, Point, PredictedPath
from ground.launch.child_command import command
from ground.launch.child_processes import defer_signals, exit_description
from runtime.clock import Clock, WallClock
from runtime.units import NS_PER_S

PATIENCE_S: Final = 30.0
CHUNK: Final = 1 << 20
REAP_S: Final = 1.0
POLITE: Final = 15
"""It gives way to what drives a robot on the same machine."""

NOTHING: Final[Mapping[str, float]] = MappingProxyType({})
CANCELLED: Final = "cancelled"
STREAMS: Final = ("in", "out", "error")


class Ghost:
    """One run: `start` it, `poll` it now and then, and `cancel` it when nobody wants it any more.

    `path_m` grows while it drives. In simulated time it has `timeout_s`, in real time `patience_s`.
    """

    def __init__(
        self,
        world: str | Facts,
        start: tuple[float, float, float],
        at_s: float,
        goal: Destination,
        navigator: str,
        parameters: Mapping[str, float] = NOTHING,
        noise: str = "none",
        seed: int = 0,
        *,
        side: str | None = None,
        timeout_s: float = 300.0,
        patience_s: float = PATIENCE_S,
        clock: Clock | None = None,
        command_of: Callable[[Sequence[str], int], list[str]] = command,
    ) -> None:
        """`world`: the name of a file, or what the plant tells of it, read or as its text. `goal`
        and `start` are places of the world; headings in radians."""
        instant = BranchPoint(world, start, at_s, goal)
        more = {"noise": noise, "seed": seed, "side": side, "timeout": repr(timeout_s)}
        self._words = trial_words(instant, navigator, more)
        for name, value in parameters.items():
            self._words += ["--param", f"{name}={value!r}"]
        self._given = world_bytes(instant)
        self._clock = clock or WallClock()
        self._patience_ns = round(patience_s * NS_PER_S)
        self._command_of = command_of
        self._reading = PathReader()
        self._process: subprocess.Popen[bytes] | None = None
        self._files: list[IO[bytes]] = []
        self._read_bytes = 0
        self._deadline_ns = 0
        self._course: PredictedPath | None = None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.cancel()

    @property
    def path_m(self) -> list[Point]:
        """As far as it has come; true places of the world."""
        return self._reading.path_m

    @property
    def pid(self) -> int | None:
        """Of its process, while there is one."""
        return None if self._process is None else self._process.pid

    @property
    def running(self) -> bool:
        return self._process is not None

    def start(self) -> None:
        """Takes a few milliseconds; a ghost that was started or cancelled is not started again."""
        if self._process is not None or self._course is not None:
            return
        try:
            self._launch()
        except OSError as error:
            self._finish(PredictedPath([], FAILED, f"it cannot be started: {error.strerror}"))
        self._deadline_ns = self._clock.now_ns() + self._patience_ns

    def _launch(self) -> None:
        for _ in STREAMS:
            self._files.append(tempfile.TemporaryFile())  # noqa: SIM115 - closed when it has ended
        given, output, words = self._files
        given.write(self._given)
        given.seek(0)
        main = threading.current_thread() is threading.main_thread()
        # A signal between start and assignment would leave an orphan.
        with defer_signals() if main else nullcontext():
            self._process = subprocess.Popen(
                self._command_of(self._words, os.getpid()),
                stdin=given,
                stdout=output,
                stderr=words,
                start_new_session=True,
            )
        with suppress(OSError):
            os.setpriority(os.PRIO_PROCESS, self._process.pid, POLITE)

    def poll(self) -> PredictedPath | None:
        """Look, without waiting: how it came out, or None while it drives."""
        process = self._process
        if process is None:
            return self._course
        code = process.poll()
        self._read()
        if code is not None:
            self._finish(
                self._reading.course(
                    self._last_words() or f"it ended with {exit_description(code)}"
                )
            )
        elif self._clock.now_ns() >= self._deadline_ns:
            self._end(f"given up after {self._patience_ns / NS_PER_S:g} s")
        return self._course

    def cancel(self) -> None:
        """End it, if it has not ended yet; nothing of it is left."""
        if self._process is not None:
            self._end(CANCELLED)
        elif self._course is None:
            self._course = PredictedPath([], CANCELLED, CANCELLED)

    def _end(self, why: str) -> None:
        process = self._process
        if process is not None:
            process.kill()  # it has nothing to put away
            with suppress(subprocess.TimeoutExpired):
                process.wait(REAP_S)
        outcome = CANCELLED if why == CANCELLED else self._reading.course(why).outcome
        self._finish(self._reading.course(why)._replace(outcome=outcome, reason=why))

    def _finish(self, course: PredictedPath) -> None:
        self._course, self._process = course, None
        for file in self._files:
            file.close()
        self._files = []

    def _read(self) -> None:
        output = self._files[1].fileno()
        while data := os.pread(output, CHUNK, self._read_bytes):
            self._read_bytes += len(data)
            self._reading.take(data)

    def _last_words(self) -> str:
        """Why it refused: the last line that it wrote to whoever reads errors."""
        said = os.pread(self._files[2].fileno(), CHUNK, 0).decode(errors="replace")
        lines = [line for line in said.splitlines() if line.strip()]
        return lines[-1].removeprefix("sidestep trial: ") if lines else ""
