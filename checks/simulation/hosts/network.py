"""The simulated network: delay, loss and order of frames between two hosts.

Links have a direction. Without an impairment the delay is constant, so frames stay in order.
"""

from collections.abc import Callable
from dataclasses import dataclass
from random import Random
from typing import Any, Final

from checks.simulation.hosts.scheduler import Host, Scheduler
from runtime.units import NS_PER_MS

USUAL_DELAY_NS: Final = 300_000
GROWN_NS: Final = 4_000 * NS_PER_MS


@dataclass(frozen=True, slots=True, kw_only=True)
class Impairment:
    """The disturbance of a link; shares are from 0 to 1.

    `paths` are the prefixes of the topics it affects; all, if empty. With `growth` the delay has
    grown by this share of the time since `since_ns`, as behind a filling queue, up to GROWN_NS.
    """

    loss: float = 0.0
    duplicate: float = 0.0
    reorder: float = 0.0
    delay_ns: int = 0
    jitter_ns: int = 0
    growth: float = 0.0
    since_ns: int = 0
    paths: tuple[str, ...] = ()

    def concerns(self, path: str) -> bool:
        """Return whether a topic is affected."""
        return not self.paths or path.startswith(self.paths)


class SimulatedLink:
    """The link from one host to another."""

    def __init__(self) -> None:
        self.impairments: tuple[tuple[Impairment, Random], ...] = ()
        self.delay_ns = USUAL_DELAY_NS

    def add(self, impairment: Impairment, salt: int) -> None:
        """Add an impairment."""
        self.impairments = (*self.impairments, (impairment, Random(salt)))

    def remove(self, impairment: Impairment) -> None:
        """Remove an impairment."""
        self.impairments = tuple(
            (one, random) for one, random in self.impairments if one is not impairment
        )

    @property
    def cut(self) -> bool:
        """True if no frame passes."""
        return any(one.loss >= 1.0 and not one.paths for one, _ in self.impairments)

    def arrivals_ns(self, path: str, now_ns: int) -> list[int]:
        """Return the delay of each copy of a frame; empty if it is lost."""
        delays_ns = [self.delay_ns]
        for impairment, random in self.impairments:
            if not impairment.concerns(path):
                continue
            draw = random.random
            if draw() < impairment.loss:
                return []
            if draw() < impairment.duplicate:
                delays_ns.append(delays_ns[0] + round(draw() * 200 * NS_PER_MS))
            late_ns = impairment.delay_ns + round(draw() * impairment.jitter_ns)
            if impairment.growth:
                late_ns += min(round(impairment.growth * (now_ns - impairment.since_ns)), GROWN_NS)
            if draw() < impairment.reorder:
                late_ns += round(draw() * 120 * NS_PER_MS)
            delays_ns = [delay_ns + late_ns for delay_ns in delays_ns]
        return delays_ns


class SimulatedNetwork:
    """All links and their state."""

    def __init__(self, scheduler: Scheduler) -> None:
        self.scheduler = scheduler
        self._links: dict[tuple[str, str], SimulatedLink] = {}

        self.sent = 0

    def link(self, source: str, target: str) -> SimulatedLink:
        """Return the link from one host to another."""
        link = self._links.get((source, target))
        if link is None:
            link = self._links[source, target] = SimulatedLink()
        return link

    def connected(self, source: Host, target: Host) -> bool:
        """Return whether frames pass from one host to another."""
        return source.alive and target.alive and not self.link(source.name, target.name).cut

    def send(
        self, source: Host, target: Host, path: str, action: Callable[..., object], *arguments: Any
    ) -> None:
        """Call `action` at the target when the frame arrives, unless it is lost."""
        scheduler = self.scheduler
        self.sent += 1
        if source is target:
            scheduler.at(scheduler.now_ns, target.deliver, action, *arguments)
            return
        link = self._links.get((source.name, target.name)) or self.link(source.name, target.name)
        if not link.impairments:
            scheduler.at(scheduler.now_ns + link.delay_ns, target.deliver, action, *arguments)
            return
        for delay_ns in link.arrivals_ns(path, scheduler.now_ns):
            scheduler.at(scheduler.now_ns + delay_ns, target.deliver, action, *arguments)
