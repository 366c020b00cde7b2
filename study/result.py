"""What a run came to: the one set of keys that a trial and a run over the bus both print."""

from dataclasses import asdict, dataclass

OUTCOMES = ("reached", "collided", "stuck", "timeout", "aborted")


@dataclass(frozen=True, slots=True, kw_only=True)
class TrialResult:
    """Errors against ground truth; `estimated_position_error_m` is what the robot believed.

    `wall_s` is the drive loop alone; `digest` a SHA-256 over the trajectory, equal for equal runs.
    """

    world: str
    navigator: str
    seed: int
    noise: str
    wall_s: float
    outcome: str
    reason: str
    time_s: float
    path_m: float
    shortest_path_m: float | None
    position_error_m: float
    heading_error_rad: float | None
    estimated_position_error_m: float
    min_clearance_m: float
    contacts: int
    ticks: int
    missed_ticks: int
    digest: str

    @property
    def reached(self) -> bool:
        return self.outcome == "reached"

    def as_json(self) -> dict[str, object]:
        return asdict(self)

    def text(self) -> str:
        """For a person, in a few lines."""
        why = f" ({self.reason})" if self.reason else ""
        pace = self.time_s / self.wall_s if self.wall_s > 0 else 0.0
        return "\n".join(
            (
                f"{self.world}, {self.navigator}, noise {self.noise}, seed {self.seed}:"
                f" {self.outcome}{why}",
                f"  time {self.time_s:.2f} s in {self.ticks} ticks ({pace:.0f} x real time)",
                f"  path {self.path_m:.2f} m, shortest {_or_unknown(self.shortest_path_m, 'm')}",
                f"  off by {self.position_error_m:.3f} m and"
                f" {_or_unknown(self.heading_error_rad, 'rad')};"
                f" believed {self.estimated_position_error_m:.3f} m",
                f"  clearance {self.min_clearance_m:.3f} m, contacts {self.contacts}",
                f"  digest {self.digest}",
            )
        )


def _or_unknown(value: float | None, unit: str) -> str:
    return "unknown" if value is None else f"{value:.3f} {unit}"
