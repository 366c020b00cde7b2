"""Who commands the robot, as its lease says."""

from typing import NamedTuple

from protocol.wire.messages import LeaseStatus
from runtime.cli.terminal import printable
from runtime.units import NS_PER_S


class Lease(NamedTuple):
    """`ours`: this station holds it; `lapses_s` from now unless its holder beats.

    Not `known`: nothing has been heard of it, or nothing lately.
    """

    held: bool = False
    ours: bool = False
    holder: str = ""
    name: str = ""
    lapses_s: float = 0.0
    known: bool = True

    @property
    def others(self) -> bool:
        return self.held and not self.ours

    @property
    def words(self) -> str:
        """Whom it belongs to; `--`: who knows."""
        if not self.known:
            return "--"
        if not self.held:
            return "free"
        return "ours" if self.ours else (self.name or self.holder[:8])


UNKNOWN = Lease(known=False)


def lease_in(status: LeaseStatus, age_ns: int, own: str) -> Lease:
    """What the robot said of it so long ago, seen by who has this identity on the bus."""
    held = bool(status.held)
    left_s = max(0.0, status.lapses_ms / 1000 - age_ns / NS_PER_S)
    ours = held and status.holder == own
    return Lease(held, ours, printable(status.holder), printable(status.name), left_s)
