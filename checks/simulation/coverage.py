"""Coverage of the runs, which shows that the absence of violations means something."""

from collections import Counter
from dataclasses import dataclass, field


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
