"""The course of a soak, and its report: figures with limits, and a table."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from math import isfinite
from pathlib import Path
from statistics import median
from typing import Final

from checks.endurance.drift import Trend, trend
from checks.endurance.fleet import Size
from checks.endurance.fleet_telemetry import RobotTelemetry
from checks.harness.figures import Figure, Report, digits, percentile
from ground.recording.catalogue import recordings_in
from ground.recording.log_reader import open_log
from protocol.topics import ANSWERED, COMMANDED, TEXT, path_of
from protocol.wire.codec import decode

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


def report_of(course: Course) -> Report:
    """Return the report of a soak."""
    figures = [*growths(course), *delays(course), *ticks(course), *healing(course)]
    notes = [
        f"{course.seconds / 60.0:.1f} min, {course.robots} robots, {course.goals} goals given,"
        f" {course.reached} reached; {len(course.done)} faults: {counted(course)}",
        *course.notes,
        *course.given_up,
        *table(course),
    ]
    return Report(benchmark="soak", figures=tuple(figures), notes=tuple(notes))


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
            yield Figure(
                name=f"{role}, {unit} in 10 min",
                unit=unit,
                values=(found.slope,),
                at_most=at_most,
            )


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
            yield Figure(
                name=f"scan to command received, p{share * 100:.0f}, {name}",
                unit="ms",
                values=(percentile(part, share),),
            )
    yield Figure(
        name="scan to command, last third / first, p50",
        unit="x",
        values=(median(last) / median(first),),
        at_most=SLOWER if judged else None,
    )


def ticks(course: Course) -> Iterator[Figure]:
    """Yield the share of missed ticks of each robot, in quiet times."""
    for robot, telemetry in course.telemetry.items():
        missed = [count for at_s, count in telemetry.ticks if course.quiet(at_s)]
        if missed:
            percent = 100.0 * sum(missed) / (sum(missed) + len(missed))
            yield Figure(
                name=f"{robot}, ticks missed in quiet times",
                unit="%",
                values=(percent,),
                at_most=MISSED_PERCENT if course.seconds >= JUDGED_S else None,
            )


def healing(course: Course) -> Iterator[Figure]:
    """Yield recovery times, lost events and processes that were given up."""
    if course.healed:
        yield Figure(
            name="until all were received again, worst",
            unit="s",
            values=(max(seconds for _, seconds in course.healed),),
            at_most=HEALED_S,
        )
    yield Figure(
        name="faults after which a robot stayed silent",
        unit="",
        values=(len(course.done) - len(course.healed),),
        at_most=0.0,
    )
    yield Figure(name="events of r1 in the log", unit="", values=(course.events,))
    yield Figure(
        name="events of r1 that the log lacks",
        unit="",
        values=(course.events_missing,),
        at_most=0.0,
    )
    yield Figure(name="processes given up", unit="", values=(len(course.given_up),), at_most=0.0)
