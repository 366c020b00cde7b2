"""What the invariants share: the time, what disturbs the run, and the first violation."""

from typing import TYPE_CHECKING, NamedTuple

from runtime.units import NS_PER_MS
from verification.simulation.coverage import Coverage
from verification.simulation.hosts.operators import History
from verification.simulation.hosts.scheduler import Scheduler

if TYPE_CHECKING:
    from verification.simulation.hosts.robot_side import RobotSide

NEVER = -(1 << 62)


class Violation(NamedTuple):
    """Which invariant does not hold, when, and what was seen."""

    invariant: str
    time_ns: int
    words: str


class Facts:
    """`violation` is the first one, None while all is well."""

    def __init__(self, scheduler: Scheduler, history: History) -> None:
        self.violation: Violation | None = None
        self.coverage = Coverage()
        self.history = history
        self.robot: RobotSide | None = None
        self.plant_ns = 0
        """Time of the plant's newest tick, on its own clock."""
        self.plant_starts = 0
        self.disturbed_until_ns = NEVER
        """Until then a process is held up or missing: ticks may be missed."""
        self.impaired_until_ns = NEVER
        """Until then frames may be lost or late."""
        self.unsure_until_ns = NEVER
        """Until then an operator does not know the robot's clock."""
        self.forged_ns = NEVER
        """Time of the plant's tick that the newest forged wheel command answers."""
        self.armed_ns = NEVER
        """When the robot was armed last, or started."""
        self.awake_ns = NEVER
        """When the plant was resumed last; the world stands still while it is suspended."""
        self.started_ns = 0
        """When the robot or the plant was started last."""
        self._scheduler = scheduler

    @property
    def now_ns(self) -> int:
        return self._scheduler.now_ns

    @property
    def events(self) -> int:
        return self._scheduler.events

    @property
    def sound_since_ns(self) -> int:
        """Since when nothing has been in the way of frames and processes; may be to come."""
        return max(self.disturbed_until_ns, self.impaired_until_ns)

    def held_up(self, until_ns: int) -> None:
        self.disturbed_until_ns = max(self.disturbed_until_ns, until_ns)

    def impaired(self, until_ns: int) -> None:
        self.impaired_until_ns = max(self.impaired_until_ns, until_ns)

    def unsure(self, until_ns: int) -> None:
        self.unsure_until_ns = max(self.unsure_until_ns, until_ns)

    def fail(self, invariant: str, words: str) -> None:
        if self.violation is None:
            self.violation = Violation(invariant, self.now_ns, words)

    def worst(self, what: str, took_ns: int) -> None:
        """Note how long something took, for the report of the worst of all runs."""
        self.coverage.longest(what, took_ns // NS_PER_MS)
