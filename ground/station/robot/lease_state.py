"""Describe the lease holder of a robot from its lease status."""

from typing import NamedTuple

from ground.client.lease_holder import named
from protocol.topic import person_of
from protocol.wire.messages import LeaseStatus
from runtime.cli.terminal import printable
from runtime.units import NS_PER_S


class LeaseView(NamedTuple):
    """A lease; `ours`: the person at this station holds it, `own`: took it with this program.

    `lapses_s` is the time left without a heartbeat or a drive. `driver` names the program that
    began the newest goal or drive. `known` is False without a recent status.
    """

    held: bool = False
    ours: bool = False
    own: bool = False
    holder: str = ""
    name: str = ""
    driver: str = ""
    lapses_s: float = 0.0
    known: bool = True

    @property
    def others(self) -> bool:
        """True if another operator holds the lease."""
        return self.held and not self.ours

    @property
    def taken(self) -> str:
        """Which other operator commands, and how to take over; empty if none does."""
        return f"{self.words} commands: `lease seize` takes over" if self.others else ""

    @property
    def words(self) -> str:
        """Name of the lease holder, or `--` when unknown; `ours`, if the same person holds it."""
        if not self.known:
            return "--"
        if not self.held:
            return "free"
        if not self.ours:
            return named(self.name, self.holder)
        return "ours" if self.own else f"ours, by {self.name}"


UNKNOWN = LeaseView(known=False)


def lease_from(status: LeaseStatus, age_ns: int, own: str) -> LeaseView:
    """Return the lease as seen by the program with identity `own`; the status is `age_ns` old."""
    held = bool(status.held)
    return LeaseView(
        held=held,
        ours=held and own != "" and person_of(status.holder) == person_of(own),
        own=held and status.holder == own,
        holder=printable(status.holder),
        name=printable(status.name),
        driver=printable(status.driver),
        lapses_s=max(0.0, status.lapses_ms / 1000 - age_ns / NS_PER_S),
    )
