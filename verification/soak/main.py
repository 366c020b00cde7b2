"""A fleet driven to and fro for a long time while things are done to it: what grows, what is lost.

Judged are processes that lived for five minutes and more; beside the fleet there is a supervisor
in a process of its own, with a plant that is left alone. Memory may grow by 1 MB in ten minutes,
open files and threads by one. From the scan to the wheel command, both heard at one place, the last
third of the run may take half as much again as the first, and one tick in a hundred may be missed;
for both, what is within five seconds of something that was done does not count. Then all robots and
their senses must be heard again within ten seconds, and the recorder lack no event of robot r1.
"""

import argparse
import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

from runtime.cli.terminal import CLEAR_LINE, steer
from runtime.clock import Clock, WallClock
from runtime.units import NS_PER_S
from verification.harness.figures import Report
from verification.soak.drive import Driver
from verification.soak.faults import Fault, faults, schedule
from verification.soak.fleet import Fleet
from verification.soak.fleet_telemetry import Heard, listen
from verification.soak.report import Course, report_of

STEP_NS: Final = 100_000_000
SAMPLE_NS: Final = 1_000_000_000
READY_NS: Final = 20 * NS_PER_S
TOLD_S: Final = 60.0


def add_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--minutes", type=float, default=30.0, metavar="N", help="(30)")
    parser.add_argument("--robots", type=int, default=3, metavar="K", help="(3)")
    parser.add_argument("--world", default="open", metavar="W", help="(open)")
    parser.add_argument("--seed", type=int, default=0, metavar="S", help="of what is done when (0)")


def measure(options: argparse.Namespace) -> Report:
    """Ctrl-C or SIGTERM ends it early; the report is of what there was until then."""
    clock = WallClock()
    with TemporaryDirectory(prefix="sidestep-soak-") as folder, interruptible():
        course = Course(robots=options.robots)
        fleet = Fleet(options.world, options.robots, options.seed, Path(folder), clock)
        with fleet:
            soak = Soak(fleet, course, clock, options.minutes * 60.0, options.seed)
            try:
                soak.run(progress())
            except KeyboardInterrupt:
                course.notes.append(f"ended by a signal after {course.seconds:.0f} s")
            course.given_up = fleet.given_up
        course.read_log(Path(folder))
    return report_of(course)


@contextmanager
def interruptible() -> Iterator[None]:
    """Also where a shell that started it in the background has it ignore Ctrl-C."""
    ends = (signal.SIGINT, signal.SIGTERM)
    before = [signal.signal(number, signal.default_int_handler) for number in ends]
    try:
        yield
    finally:
        for number, handler in zip(ends, before, strict=True):
            signal.signal(number, handler)


def progress() -> Callable[[float, str], None]:
    """A live line on a terminal; elsewhere a line a minute."""
    told_s = 0.0

    def tell(at_s: float, words: str) -> None:
        nonlocal told_s
        if sys.stderr.isatty():
            steer(sys.stderr, CLEAR_LINE)
            print(words, end="", file=sys.stderr, flush=True)
        elif at_s - told_s >= TOLD_S:
            told_s = at_s
            print(words, file=sys.stderr, flush=True)

    return tell


class Soak:
    """One run: looks ten times a second, samples once a second."""

    def __init__(
        self, fleet: Fleet, course: Course, clock: Clock, seconds: float, seed: int
    ) -> None:
        self._fleet = fleet
        self._course = course
        self._clock = clock
        self._seconds = seconds
        self._plan = schedule(faults(fleet.roles), seconds, seed)
        self._next = next(self._plan, None)
        self._begun: tuple[Fault, float] | None = None
        self._waits_ns: int | None = None
        self._began_ns = clock.now_ns()
        self._sample_ns = 0

    def run(self, tell: Callable[[float, str], None]) -> None:
        robots = self._fleet.scenario.robots
        self._course.heard = heard = listen(self._fleet.bus, robots, self._began_ns)
        drivers = [Driver(self._fleet.bus, robot) for robot in robots]
        self._await_all(heard)
        self._course.ready_s = self._now_s()
        while self._now_s() < self._seconds:
            due_ns = self._clock.now_ns() + STEP_NS
            self._fleet.look_after()
            self._disturb()
            self._look_for_the_healed(heard)
            self._sample()
            for driver in drivers:
                driver.poll(heard[driver.robot], self._clock.now_ns())
            self._course.seconds = self._now_s()
            self._course.goals = sum(driver.goals for driver in drivers)
            self._course.reached = sum(driver.reached for driver in drivers)
            tell(self._course.seconds, self._line())
            self._clock.sleep_until(due_ns)

    def _now_s(self) -> float:
        return (self._clock.now_ns() - self._began_ns) / NS_PER_S

    def _await_all(self, heard: dict[str, Heard]) -> None:
        while any(one.silent_since(0) for one in heard.values()):
            if self._clock.now_ns() - self._began_ns > READY_NS:
                raise RuntimeError("the fleet does not come up: " + "; ".join(self._fleet.given_up))
            self._fleet.look_after()
            self._clock.sleep_until(self._clock.now_ns() + STEP_NS)

    def _disturb(self) -> None:
        now_s = self._now_s()
        if self._begun is not None:
            fault, begun_s = self._begun
            if now_s - begun_s < fault.lasts_s:
                return
            self._fleet.undo(fault)
            self._begun, self._waits_ns = None, self._clock.now_ns()
            self._course.done.append((fault.name, begun_s, now_s))
        elif self._next is not None and now_s >= self._next[0]:
            self._begun = self._next[1], now_s
            self._fleet.do(self._next[1])
            self._next = next(self._plan, None)

    def _look_for_the_healed(self, heard: dict[str, Heard]) -> None:
        """All of them, from the end of what was done; when the next begins it has not healed."""
        since_ns = self._waits_ns
        if since_ns is None or self._begun is not None:
            return
        if not any(one.silent_since(since_ns) for one in heard.values()):
            healed_s = (self._clock.now_ns() - since_ns) / NS_PER_S
            self._course.healed.append((self._course.done[-1][0], healed_s))
            self._waits_ns = None

    def _sample(self) -> None:
        if self._clock.now_ns() >= self._sample_ns:
            self._sample_ns = self._clock.now_ns() + SAMPLE_NS
            self._course.sample(self._now_s(), self._fleet.sizes())

    def _line(self) -> str:
        course = self._course
        minutes, whole = course.seconds / 60.0, self._seconds / 60.0
        return (
            f"{minutes:.1f} of {whole:g} min, {len(course.done)} faults,"
            f" {course.goals} goals, {course.reached} reached"
        )
