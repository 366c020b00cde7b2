"""The shared state of the invariants: time, disturbances, the first violation, and the coverage.

The coverage of the runs shows that the absence of violations means something.
"""

from collections import Counter
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, NamedTuple

from checks.simulation.hosts.operators import RequestHistory
from checks.simulation.hosts.virtual_time import Scheduler
from runtime.units import NS_PER_MS

if TYPE_CHECKING:
    from checks.simulation.hosts.robot_and_plant import RobotSide


@dataclass(slots=True)
class Coverage:
    """Counts over runs; `reached` counts situations, each once per run."""

    plant_ticks: int = 0
    moving_ticks: int = 0
    robot_ticks: int = 0
    requests: int = 0
    accepted: int = 0
    stops: int = 0
    """Emergency stops that were acknowledged to an operator."""
    reached: Counter[str] = field(default_factory=Counter)
    worst_ms: dict[str, int] = field(default_factory=dict)

    def longest(self, what: str, took_ms: int) -> None:
        """Keep the longest duration of a reaction."""
        self.worst_ms[what] = max(self.worst_ms.get(what, 0), took_ms)

    def add(self, other: "Coverage") -> None:
        """Add the counts of other runs."""
        self.plant_ticks += other.plant_ticks
        self.moving_ticks += other.moving_ticks
        self.robot_ticks += other.robot_ticks
        self.requests += other.requests
        self.accepted += other.accepted
        self.stops += other.stops
        self.reached.update(other.reached)
        for what, took_ms in other.worst_ms.items():
            self.longest(what, took_ms)

    @property
    def moving_percent(self) -> float:
        """Share of the plant's ticks in which the wheels turned."""
        return 100.0 * self.moving_ticks / self.plant_ticks if self.plant_ticks else 0.0

    def lines(self) -> list[str]:
        """Return the counts in words."""
        head = (
            f"wheels turned in {self.moving_percent:.0f} % of {self.plant_ticks} ticks; "
            f"{self.accepted} of {self.requests} requests accepted; "
            f"{self.stops} stops acknowledged"
        )
        found = ", ".join(f"{name} {count}" for name, count in sorted(self.reached.items()))
        worst = ", ".join(f"{what} {ms} ms" for what, ms in sorted(self.worst_ms.items()))
        return [head, f"runs that reached: {found}", *([f"worst: {worst}"] if worst else [])]


NEVER = -(1 << 62)


class InvariantViolation(NamedTuple):
    """The violated invariant, the time, and the observation."""

    invariant: str
    time_ns: int
    words: str


class RunState:
    """The state of a run; `violation` is the first one, or None."""

    def __init__(self, scheduler: Scheduler, history: RequestHistory) -> None:
        self.violation: InvariantViolation | None = None
        self.coverage = Coverage()
        self.history = history
        self.robot: RobotSide | None = None
        self.plant_ns = 0
        """Time of the plant's newest tick, on its own clock."""
        self.plant_starts = 0
        self.disturbed_until_ns = NEVER
        """Until then a process is delayed or missing, so ticks may be missed."""
        self.impaired_until_ns = NEVER
        """Until then frames may be lost or late."""
        self.stands_until_ns = NEVER
        """Until then the plant's clock stands still, in lockstep."""
        self.disk_until_ns = NEVER
        """Until then the robot's disk may be slow or failing."""
        self.unsure_until_ns = NEVER
        """Until then an operator does not know the robot's clock."""
        self.forged_ns = NEVER
        """Time of the plant's tick that the newest forged wheel command answers."""
        self.is_placed = False
        """True once an operator has set the pose, by which the robot keeps within its fence."""
        self.armed_ns = NEVER
        """Last time the robot was armed or started."""
        self.awake_ns = NEVER
        """Last time the plant was resumed; the world does not move while it is suspended."""
        self.started_ns = 0
        """Last start of the robot or the plant."""
        self._scheduler = scheduler

    @property
    def now_ns(self) -> int:
        """The simulated time."""
        return self._scheduler.now_ns

    @property
    def events(self) -> int:
        """The number of events so far."""
        return self._scheduler.events

    @property
    def sound_since_ns(self) -> int:
        """The time since which frames and processes are undisturbed; may be in the future."""
        return max(self.disturbed_until_ns, self.impaired_until_ns, self.stands_until_ns)

    @property
    def stands(self) -> bool:
        """True while the plant's clock stands still."""
        return self.now_ns <= self.stands_until_ns

    def held_up(self, until_ns: int) -> None:
        """Record that a process is delayed or missing until a time."""
        self.disturbed_until_ns = max(self.disturbed_until_ns, until_ns)

    def impaired(self, until_ns: int) -> None:
        """Record that frames may be lost or late until a time."""
        self.impaired_until_ns = max(self.impaired_until_ns, until_ns)

    def unsure(self, until_ns: int) -> None:
        """Record that an operator does not know the robot's clock until a time."""
        self.unsure_until_ns = max(self.unsure_until_ns, until_ns)

    def fail(self, invariant: str, words: str) -> None:
        """Record a violation, unless there is one already."""
        if self.violation is None:
            self.violation = InvariantViolation(invariant, self.now_ns, words)

    def worst(self, what: str, took_ns: int) -> None:
        """Record the duration of a reaction, for the report of the longest ones."""
        self.coverage.longest(what, took_ns // NS_PER_MS)
