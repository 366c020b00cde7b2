"""Drive a fleet to and fro for a long time while faults happen; report growth and losses.

Only processes that lived for at least five minutes are judged. Beside the fleet runs a supervisor
in a process of its own, with a plant that is never killed. Limits per ten minutes: 1 MB of memory,
one open file, one thread. Growth is a slope with its confidence.

Scan and wheel command are timed at one place: in the last third of the run the delay may be at most
1.5 times that of the first. At most one tick in a hundred may be missed. Both exclude the five
seconds after a fault. After a fault, all robots and their senses must be received again within ten
seconds. The recorder must have every event of robot r1.
"""

import argparse
import signal
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from math import inf, isfinite, sqrt
from pathlib import Path
from statistics import fmean, median
from tempfile import TemporaryDirectory
from typing import Final, NamedTuple

from checks.endurance.fleet import (
    GoalSender,
    RobotTelemetry,
    Size,
    SoakFault,
    SoakFleet,
    faults,
    schedule,
    subscribe,
)
from checks.harness.figures import BenchmarkReport, Figure, digits, figure, percentile
from ground.recording.catalogue import recordings_in
from ground.recording.log_reader import open_log
from protocol.topics import ANSWERED, COMMANDED, TEXT, path_of
from protocol.wire.codec import decode
from runtime.cli.terminal import CLEAR_LINE, steer
from runtime.clock import Clock, WallClock
from runtime.units import NS_PER_S

SETTLE_S: Final = 60.0
"""A new process still grows: this beginning of its life is left out, at most a third of it."""
BLOCK_S: Final = 30.0
"""Samples a second apart correlate, so means over blocks count; a life has at least six."""
TEN_MINUTES_S: Final = 600.0

Life = Sequence[tuple[float, float]]
"""Time in seconds and value, of one process from its start to its end."""


class Trend(NamedTuple):
    """A slope per ten minutes with its 95 % margin, which is infinite with too few samples."""

    slope: float
    margin: float
    first: float
    last: float
    longest_s: float


def trend(lives: Sequence[Life]) -> Trend | None:
    """Fit one slope to all lives of a process, each with its own level; None without samples."""
    settled = [one for one in map(settle, lives) if one]
    if not settled:
        return None
    slope, margin = common_slope([blocks(life) for life in settled])
    values = [value for life in settled for _, value in life]
    third = max(1, len(values) // 3)
    return Trend(
        slope=slope * TEN_MINUTES_S,
        margin=margin * TEN_MINUTES_S,
        first=median(values[:third]),
        last=median(values[-third:]),
        longest_s=max(life[-1][0] - life[0][0] for life in settled),
    )


def settle(life: Life) -> Life:
    """Leave out the beginning of a life."""
    if not life:
        return life
    begin_s, end_s = life[0][0], life[-1][0]
    after_s = begin_s + min(SETTLE_S, (end_s - begin_s) / 3)
    return [sample for sample in life if sample[0] >= after_s]


def blocks(life: Life) -> list[tuple[float, float]]:
    """Return the means of time and value over blocks of the same length."""
    begin_s, end_s = life[0][0], life[-1][0]
    length_s = min(BLOCK_S, (end_s - begin_s) / 6) or BLOCK_S
    found: dict[int, list[tuple[float, float]]] = {}
    for sample in life:
        found.setdefault(int((sample[0] - begin_s) / length_s), []).append(sample)
    return [(fmean(t for t, _ in part), fmean(v for _, v in part)) for part in found.values()]


def common_slope(lives: Sequence[Life]) -> tuple[float, float]:
    """Return the least-squares slope within the lives and its 95 % margin, per second."""
    pairs = [pair for life in lives for pair in centred(life)]
    spread = sum(t * t for t, _ in pairs)
    freedom = len(pairs) - len(lives) - 1
    if not spread:
        return 0.0, inf
    slope = sum(t * v for t, v in pairs) / spread
    if freedom < 1:
        return slope, inf
    rest = sum((v - slope * t) ** 2 for t, v in pairs)
    return slope, student(freedom) * sqrt(rest / freedom / spread)


def centred(life: Life) -> list[tuple[float, float]]:
    """Subtract the mean time and value."""
    middle_t, middle_v = fmean(t for t, _ in life), fmean(v for _, v in life)
    return [(t - middle_t, v - middle_v) for t, v in life]


def student(freedom: int) -> float:
    """Return Student's t at 97.5 %, within 1 % of the tables from 3 degrees of freedom on."""
    return 1.96 + 2.37 / freedom + 2.82 / freedom**2 + 2.5 / freedom**3


JUDGED_S: Final = 300.0
AFTERMATH_S: Final = 5.0
HEALED_S: Final = 10.0
GROWTH: Final[Mapping[str, tuple[str, float]]] = {
    "rss_mb": ("MB", 1.0),
    "files": ("files", 1.0),
    "threads": ("threads", 1.0),
}
SLOWER: Final = 1.5
MISSED_PERCENT: Final = 1.0
EVENTS: Final = (TEXT.path, COMMANDED.path, ANSWERED.path)


@dataclass(kw_only=True)
class Course:
    """The events and samples of a soak; times are in seconds from the beginning."""

    robots: int
    seconds: float = 0.0
    ready_s: float = 0.0
    goals: int = 0
    reached: int = 0
    telemetry: dict[str, RobotTelemetry] = field(default_factory=dict)
    done: list[tuple[str, float, float]] = field(default_factory=list)
    healed: list[tuple[str, float]] = field(default_factory=list)
    given_up: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    sizes: dict[str, dict[int, list[tuple[float, Size]]]] = field(default_factory=dict)
    events: int = 0
    events_missing: int = 0

    def sample(self, at_s: float, found: Mapping[tuple[str, int], Size]) -> None:
        """Add the sizes of all processes."""
        for (role, pid), size in found.items():
            self.sizes.setdefault(role, {}).setdefault(pid, []).append((at_s, size))

    def read_log(self, folder: Path) -> None:
        """Count the events of the recorded robot, and the gaps between them."""
        last: dict[str, int] = {}
        for file in reversed(recordings_in(folder)):
            for one in open_log(file):
                path = path_of(one.key)
                if path in EVENTS:
                    sequence = decode(one.frame).sequence
                    expected = (last.get(path, sequence - 1) + 1) & 0xFF
                    self.events += 1
                    self.events_missing += (sequence - expected) & 0xFF
                    last[path] = sequence

    def quiet(self, at_s: float) -> bool:
        """Return whether no fault happened then or shortly before."""
        return at_s >= self.ready_s + AFTERMATH_S and not any(
            begun_s <= at_s <= ended_s + AFTERMATH_S for _, begun_s, ended_s in self.done
        )

    def any_silent_since(self, at_ns: int) -> bool:
        """Return whether a robot or its senses have not been received since then."""
        return any(one.silent_since(at_ns) for one in self.telemetry.values())


def report_of(course: Course) -> BenchmarkReport:
    """Return the report of a soak."""
    figures = [*growths(course), *delays(course), *ticks(course), *healing(course)]
    notes = [
        f"{course.seconds / 60.0:.1f} min, {course.robots} robots, {course.goals} goals given,"
        f" {course.reached} reached; {len(course.done)} faults: {counted(course)}",
        *course.notes,
        *course.given_up,
        *table(course),
    ]
    return BenchmarkReport(benchmark="soak", figures=tuple(figures), notes=tuple(notes))


def counted(course: Course) -> str:
    """Return the faults with their numbers."""
    names = [name for name, _, _ in course.done]
    return ", ".join(f"{names.count(name)} x {name}" for name in dict.fromkeys(names)) or "none"


def trends(course: Course) -> Iterator[tuple[str, str, Trend]]:
    """Yield the trend of each quantity of each process."""
    for role, lives in course.sizes.items():
        for name in GROWTH:
            found = trend([[(t, getattr(s, name)) for t, s in life] for life in lives.values()])
            if found is not None:
                yield role, name, found


def growths(course: Course) -> Iterator[Figure]:
    """Yield the growth of processes that lived long enough; the table has the others."""
    for role, name, found in trends(course):
        if found.longest_s >= JUDGED_S:
            unit, at_most = GROWTH[name]
            yield figure(f"{role}, {unit} in 10 min", found.slope, unit, at_most=at_most)


def table(course: Course) -> Iterator[str]:
    """Yield first third, last third and slope with confidence, per process and quantity."""
    for role, name, found in trends(course):
        unit, _ = GROWTH[name]
        margin = f" +- {found.margin:.2f}" if isfinite(found.margin) else ""
        lives = len(course.sizes[role])
        yield (
            f"{role}: {digits(found.first)} -> {digits(found.last)} {unit},"
            f" {found.slope:+.2f}{margin} in 10 min, {lives} {'life' if lives == 1 else 'lives'}"
        )


def delays(course: Course) -> Iterator[Figure]:
    """Yield the delays of all robots together, in quiet times."""
    values = sorted(
        sample
        for one in course.telemetry.values()
        for sample in one.delays_ms
        if course.quiet(sample[0])
    )
    third = len(values) // 3
    if not third:
        return
    first, last = ([delay for _, delay in part] for part in (values[:third], values[-third:]))
    judged = course.seconds >= JUDGED_S
    for name, part in (("first third", first), ("last third", last)):
        for share in (0.5, 0.99):
            yield figure(
                f"scan to command received, p{share * 100:.0f}, {name}",
                percentile(part, share),
                "ms",
            )
    yield figure(
        "scan to command, last third / first, p50",
        median(last) / median(first),
        "x",
        at_most=SLOWER if judged else None,
    )


def ticks(course: Course) -> Iterator[Figure]:
    """Yield the share of missed ticks of each robot, in quiet times."""
    for robot, telemetry in course.telemetry.items():
        missed = [count for at_s, count in telemetry.ticks if course.quiet(at_s)]
        if missed:
            percent = 100.0 * sum(missed) / (sum(missed) + len(missed))
            yield figure(
                f"{robot}, ticks missed in quiet times",
                percent,
                "%",
                at_most=MISSED_PERCENT if course.seconds >= JUDGED_S else None,
            )


def healing(course: Course) -> Iterator[Figure]:
    """Yield recovery times, lost events and processes that were given up."""
    if course.healed:
        yield figure(
            "until all were received again, worst",
            max(seconds for _, seconds in course.healed),
            "s",
            at_most=HEALED_S,
        )
    yield figure(
        "faults after which a robot stayed silent",
        len(course.done) - len(course.healed),
        at_most=0.0,
    )
    yield figure("events of r1 in the log", course.events)
    yield figure("events of r1 that the log lacks", course.events_missing, at_most=0.0)
    yield figure("processes given up", len(course.given_up), at_most=0.0)


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


def measure(options: argparse.Namespace) -> BenchmarkReport:
    """Run the soak; Ctrl-C or SIGTERM ends it early, with a report of what was measured."""
    clock = WallClock()
    with TemporaryDirectory(prefix="sidestep-soak-") as folder, interruptible():
        course = Course(robots=options.robots)
        fleet = SoakFleet(options.world, options.robots, options.seed, Path(folder), clock)
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
        self, fleet: SoakFleet, course: Course, clock: Clock, seconds: float, seed: int
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
