"""Run other navigators from an instant of a run, each in a process, and report them in the log.

At most one per core runs at the same time. A thread that stays alive creates and starts them: Linux
ends a child with its starting thread.
"""

import os
import subprocess
import tempfile
import threading
from collections.abc import Callable, Mapping, Sequence
from contextlib import nullcontext, suppress
from types import MappingProxyType
from typing import IO, Final, Self

from ground.branch_point import (
    FAILED,
    BranchPoint,
    PathReader,
    Point,
    PredictedPath,
    changed,
    driving,
    goal_of,
    side_of,
    trial_words,
    world_bytes,
)
from ground.client.goal import Destination
from ground.launch.child_command import command
from ground.launch.child_processes import defer_signals, exit_description
from ground.map.scene import GhostTrail
from ground.station.station import Station
from protocol.navigators import NAVIGATORS, is_own, name_of
from protocol.outcome import detail_of
from protocol.topics import ODOMETRY, STATUS, TRUTH
from protocol.wire.enums import GoalState, Severity
from protocol.wire.messages import GroundTruth, PlanarOdometry
from runtime.clock import Clock, WallClock
from runtime.errors import UserError
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
        world: str,
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
        """Create a ghost; `world` is a file name or the JSON of the plant's description.

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


class Ghosts:
    """Ghosts by label, in the order in which they were added."""

    def __init__(self, most: int | None = None) -> None:
        self._most = max(1, most if most is not None else os.cpu_count() or 1)
        self._ghosts: dict[str, Ghost] = {}
        self._courses: dict[str, PredictedPath] = {}

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.clear()

    def add(self, label: str, ghost: Ghost) -> None:
        """Add a ghost, which starts when a core is free; it replaces another of the same label."""
        self.remove(label)
        self._ghosts[label] = ghost
        self._start()

    def poll(self) -> list[str]:
        """Poll all ghosts without waiting; return the labels of those that have just ended."""
        ended = []
        for label, ghost in self._ghosts.items():
            course = None if label in self._courses else ghost.poll()
            if course is not None:
                self._courses[label] = course
                ended.append(label)
        self._start()
        return ended

    @property
    def courses(self) -> dict[str, PredictedPath | None]:
        """Result of each ghost; None while it waits or runs."""
        return {label: self._courses.get(label) for label in self._ghosts}

    @property
    def busy(self) -> bool:
        """True if a ghost waits or runs."""
        return len(self._courses) < len(self._ghosts)

    @property
    def pids(self) -> list[int]:
        """Process ids of the running ghosts."""
        return [ghost.pid for ghost in self._ghosts.values() if ghost.pid is not None]

    def trails(self) -> list[GhostTrail]:
        """Return the paths for the map; a running ghost has an empty outcome."""
        return [
            GhostTrail(label, ghost.path_m, "" if course is None else course.outcome)
            for (label, ghost), course in zip(
                self._ghosts.items(), self.courses.values(), strict=True
            )
        ]

    def remove(self, label: str) -> None:
        """Remove a ghost if it exists."""
        self._courses.pop(label, None)
        ghost = self._ghosts.pop(label, None)
        if ghost is not None:
            ghost.cancel()

    def clear(self) -> None:
        """Remove all ghosts."""
        for label in list(self._ghosts):
            self.remove(label)

    def _start(self) -> None:
        room = self._most - len(self.pids)
        for label, ghost in self._ghosts.items():
            if room > 0 and not ghost.running and label not in self._courses:
                ghost.start()
                room -= 1


ALL: Final = "all"
NONE: Final = "none"
CHOICES: Final = (*NAVIGATORS, ALL, NONE)
NO_WORLD: Final = "the world is unknown: a ghost needs a simulation, or a recording with its world"


class GhostRunner:
    """Starts ghosts on request, polls them with the station, and returns their paths."""

    def __init__(self, shown: Callable[[], Station], ghosts: Ghosts | None = None) -> None:
        """Create a runner; `shown` returns the present station."""
        self._shown = shown
        self._ghosts = ghosts or Ghosts()
        self._world = ""

    def begin(self, choice: str) -> None:
        """Start a navigator or `all` of them, or remove the ghosts with `none`. Raises UserError.

        A ghost replaces an earlier one of the same navigator.
        """
        if choice == NONE:
            self.clear()
            return
        if choice not in CHOICES and not is_own(choice):
            raise UserError(f"no navigator {choice!r}: {', '.join(CHOICES)}")
        station = self._shown()
        instant, status = instant_of(station), station.telemetry.live(STATUS, station.now_ns)
        side = None if status is None else side_of(status)
        parameters = driving(changed(station.parameters or ()))
        self._world = world_of(station)
        for name in NAVIGATORS if choice == ALL else (choice,):
            self._ghosts.add(name_of(name), Ghost(*instant, name, parameters, side=side))

    def poll(self) -> None:
        """Report the ghosts that have ended; remove all of them in another world."""
        station = self._shown()
        if self._world and world_of(station) not in ("", self._world):
            self.clear()
        for name in self._ghosts.poll():
            course = self._ghosts.courses[name]
            if course is not None:
                severity = Severity.WARNING if course.outcome == FAILED else Severity.INFO
                station.note(f"ghost {name}: {result_line(course)}", severity)

    @property
    def busy(self) -> bool:
        """True if a ghost waits or runs."""
        return self._ghosts.busy

    def trails(self) -> list[GhostTrail]:
        """Return the paths for `Scene.ghosts`."""
        return self._ghosts.trails()

    def clear(self) -> None:
        """End all ghosts and forget their paths."""
        self._ghosts.clear()
        self._world = ""


def instant_of(station: Station) -> BranchPoint:
    """Return the present pose of the shown robot, the true one if known; UserError if data lack."""
    world, telemetry, now_ns = station.world, station.telemetry, station.now_ns
    status = telemetry.live(STATUS, now_ns)
    place: GroundTruth | PlanarOdometry | None = telemetry.live(TRUTH, now_ns)
    at_s = 0.0 if place is None else place.time_ns / NS_PER_S
    place = place or telemetry.live(ODOMETRY, now_ns)
    if world is None:
        raise UserError(NO_WORLD)
    if status is None or place is None:
        raise UserError("the robot sends no data now")
    if status.goal == GoalState.NONE:
        raise UserError("the robot has no goal at this instant")
    goal: Destination = goal_of(status)
    return BranchPoint(world.text, (place.x_m, place.y_m, place.heading_rad), at_s, goal)


def world_of(station: Station) -> str:
    """Return the identity of a world; empty while none is known."""
    return "" if station.world is None else station.world.text


def result_line(course: PredictedPath) -> str:
    """Describe the result in one line."""
    words = course.outcome
    if course.time_s is not None and course.length_m is not None:
        words += f" after {course.time_s:.1f} s and {course.length_m:.2f} m"
    if course.reason in ("ok", ""):
        return words
    return f"{words}: {detail_of(course.outcome, course.reason)}"
