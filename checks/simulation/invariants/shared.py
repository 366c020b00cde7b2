"""The shared state of the invariants: time, disturbances and the first violation."""

from typing import TYPE_CHECKING, NamedTuple

from checks.simulation.coverage import Coverage
from checks.simulation.hosts.operators import RequestHistory
from checks.simulation.hosts.scheduler import Scheduler
from runtime.units import NS_PER_MS

if TYPE_CHECKING:
    from checks.simulation.hosts.robot_side import RobotSide

NEVER = -(1 << 62)


class Violation(NamedTuple):
    """The violated invariant, the time, and the observation."""

    invariant: str
    time_ns: int
    words: str


class RunState:
    """The state of a run; `violation` is the first one, or None."""

    def __init__(self, scheduler: Scheduler, history: RequestHistory) -> None:
        self.violation: Violation | None = None
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
            self.violation = Violation(invariant, self.now_ns, words)

    def worst(self, what: str, took_ns: int) -> None:
        """Record the duration of a reaction, for the report of the longest ones."""
        self.coverage.longest(what, took_ns // NS_PER_MS)
