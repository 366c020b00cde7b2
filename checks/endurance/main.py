"""Drive a fleet to and fro for a long time while faults happen; report growth and losses.

Only processes that lived for at least five minutes are judged. Beside the fleet runs a supervisor
in a process of its own, with a plant that is never killed. Limits per ten minutes: 1 MB of memory,
one open file, one thread.

Scan and wheel command are timed at one place: in the last third of the run the delay may be at most
1.5 times that of the first. At most one tick in a hundred may be missed. Both exclude the five
seconds after a fault. After a fault, all robots and their senses must be received again within ten
seconds. The recorder must have every event of robot r1.
"""

import argparse
import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

from checks.endurance.drive import GoalSender
from checks.endurance.faults import SoakFault, faults, schedule
from checks.endurance.fleet import Fleet
from checks.endurance.fleet_telemetry import subscribe
from checks.endurance.report import HEALED_S, Course, report_of
from checks.harness.figures import Report
from runtime.cli.terminal import CLEAR_LINE, steer
from runtime.clock import Clock, WallClock
from runtime.units import NS_PER_S

STEP_NS: Final = 100_000_000
SAMPLE_NS: Final = 1_000_000_000
READY_NS: Final = 20 * NS_PER_S
SHOWN_S: Final = 60.0


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of `bench soak`."""
    parser.add_argument("--minutes", type=float, default=30.0, metavar="N", help="(30)")
    parser.add_argument("--robots", type=int, default=3, metavar="K", help="(3)")
    parser.add_argument("--world", default="open", metavar="W", help="(open)")
    parser.add_argument(
        "--seed", type=int, default=0, metavar="S", help="of the order of faults (0)"
    )


def measure(options: argparse.Namespace) -> Report:
    """Run the soak; Ctrl-C or SIGTERM ends it early, with a report of what was measured."""
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
    """Let Ctrl-C interrupt the run even if a shell started it in the background."""
    ends = (signal.SIGINT, signal.SIGTERM)
    before = [signal.signal(number, signal.default_int_handler) for number in ends]
    try:
        yield
    finally:
        for number, handler in zip(ends, before, strict=True):
            signal.signal(number, handler)


def progress() -> Callable[[float, str], None]:
    """Return a function that shows a live line on a terminal, elsewhere a line a minute."""
    shown_s = 0.0

    def show(at_s: float, words: str) -> None:
        nonlocal shown_s
        if sys.stderr.isatty():
            steer(sys.stderr, CLEAR_LINE)
            print(words, end="", file=sys.stderr, flush=True)
        elif at_s - shown_s >= SHOWN_S:
            shown_s = at_s
            print(words, file=sys.stderr, flush=True)

    return show


class Soak:
    """A run: it checks the fleet ten times a second and samples it once a second."""

    def __init__(
        self, fleet: Fleet, course: Course, clock: Clock, seconds: float, seed: int
    ) -> None:
        self._fleet = fleet
        self._course = course
        self._clock = clock
        self._seconds = seconds
        self._plan = schedule(faults(fleet.roles), seconds, seed)
        self._next = next(self._plan, None)
        self._begun: tuple[SoakFault, float] | None = None
        self._waits_ns: int | None = None
        self._began_ns = clock.now_ns()
        self._sample_ns = 0

    def run(self, show: Callable[[float, str], None]) -> None:
        """Drive, disturb and sample the fleet until the time is over."""
        robots = self._fleet.scenario.robots
        telemetry = subscribe(self._fleet.bus, robots, self._began_ns)
        self._course.telemetry = telemetry
        drivers = [GoalSender(self._fleet.bus, robot) for robot in robots]
        self._await_all()
        self._course.ready_s = self._now_s()
        while not self._is_over():
            due_ns = self._clock.now_ns() + STEP_NS
            self._fleet.look_after()
            self._disturb()
            self._check_recovery()
            self._sample()
            for driver in drivers:
                driver.poll(telemetry[driver.robot], self._clock.now_ns())
            self._course.seconds = self._now_s()
            self._course.goals = sum(driver.goals for driver in drivers)
            self._course.reached = sum(driver.reached for driver in drivers)
            show(self._course.seconds, self._line())
            self._clock.sleep_until(due_ns)

    def _is_over(self) -> bool:
        """Return whether the time is up, and the fleet recovered or had the time to recover."""
        if self._now_s() < self._seconds:
            return False
        return not self._is_recovering()

    def _is_recovering(self) -> bool:
        """Return whether robots are still silent after a fault and have time left to recover."""
        since_ns = self._waits_ns
        return since_ns is not None and self._clock.now_ns() - since_ns <= HEALED_S * NS_PER_S

    def _now_s(self) -> float:
        return (self._clock.now_ns() - self._began_ns) / NS_PER_S

    def _await_all(self) -> None:
        while self._course.any_silent_since(0):
            if self._clock.now_ns() - self._began_ns > READY_NS:
                raise RuntimeError("the fleet did not start: " + "; ".join(self._fleet.given_up))
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
        elif self._next and now_s >= self._next[0] and not self._is_recovering():
            self._begun = self._next[1], now_s
            self._fleet.do(self._next[1])
            self._next = next(self._plan, None)

    def _check_recovery(self) -> None:
        """Note when all robots are received again, unless the next fault has begun."""
        since_ns = self._waits_ns
        if since_ns is None or self._begun is not None:
            return
        if not self._course.any_silent_since(since_ns):
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
