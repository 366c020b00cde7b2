"""Run another navigator from an instant of a run in a separate process.

Create and start it in a thread that stays alive: Linux ends a child with its starting thread.
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
"""Lower priority: the process must not disturb a robot on the same machine."""

NOTHING: Final[Mapping[str, float]] = MappingProxyType({})
CANCELLED: Final = "cancelled"
STREAMS: Final = ("in", "out", "error")


class Ghost:
    """One predicted run: `start` it, `poll` it regularly, and `cancel` it when it is not needed.

    `path_m` grows during the run. Limits are `timeout_s` in simulated and `patience_s` in real
    time.
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
        """Create a ghost; `world` is a file name or the plant's description, parsed or as text.

        `goal` and `start` are poses in the world with headings in radians.
        """
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
        """Path so far, in world coordinates."""
        return self._reading.path_m

    @property
    def pid(self) -> int | None:
        """Process id while it runs."""
        return None if self._process is None else self._process.pid

    @property
    def running(self) -> bool:
        """True if the process runs."""
        return self._process is not None

    def start(self) -> None:
        """Start the process, which takes a few milliseconds; a second start has no effect."""
        if self._process is not None or self._course is not None:
            return
        try:
            self._launch()
        except OSError as error:
            self._finish(
                PredictedPath([], FAILED, f"the process cannot be started: {error.strerror}")
            )
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
        """Return the result, or None while it runs, without waiting."""
        process = self._process
        if process is None:
            return self._course
        code = process.poll()
        self._read()
        if code is not None:
            self._finish(
                self._reading.course(
                    self._last_error_line() or f"the process ended with {exit_description(code)}"
                )
            )
        elif self._clock.now_ns() >= self._deadline_ns:
            self._end(f"given up after {self._patience_ns / NS_PER_S:g} s")
        return self._course

    def cancel(self) -> None:
        """End the process and remove everything it left."""
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

    def _last_error_line(self) -> str:
        """Return the last line of its error output."""
        output = os.pread(self._files[2].fileno(), CHUNK, 0).decode(errors="replace")
        lines = [line for line in output.splitlines() if line.strip()]
        return lines[-1].removeprefix("sidestep trial: ") if lines else ""
