"""Describe the lease holder of a robot from its lease status."""

from typing import NamedTuple

from protocol.wire.messages import LeaseStatus
from runtime.cli.terminal import printable
from runtime.units import NS_PER_S


class LeaseView(NamedTuple):
    """A lease; `ours`: this station holds it; `lapses_s`: time left without a heartbeat.

    `known` is False without a recent status.
    """

    held: bool = False
    ours: bool = False
    holder: str = ""
    name: str = ""
    lapses_s: float = 0.0
    known: bool = True

    @property
    def others(self) -> bool:
        """True if another operator holds the lease."""
        return self.held and not self.ours

    @property
    def words(self) -> str:
        """Name of the lease holder, or `--` when unknown."""
        if not self.known:
            return "--"
        if not self.held:
            return "free"
        return "ours" if self.ours else (self.name or self.holder[:8])


UNKNOWN = LeaseView(known=False)


def lease_from(status: LeaseStatus, age_ns: int, own: str) -> LeaseView:
    """Return the lease as seen by the client with identity `own`; the status is `age_ns` old."""
    held = bool(status.held)
    left_s = max(0.0, status.lapses_ms / 1000 - age_ns / NS_PER_S)
    ours = held and status.holder == own
    return LeaseView(held, ours, printable(status.holder), printable(status.name), left_s)
