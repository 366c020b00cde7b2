"""The simulated network: what happens to each frame between two hosts.

Links have a direction. Without an impairment a frame takes a fixed time, so frames stay in order.
"""

from collections.abc import Callable
from dataclasses import dataclass
from random import Random
from typing import Any, Final

from runtime.units import NS_PER_MS
from verification.simulation.hosts.scheduler import Host, Scheduler

USUAL_DELAY_NS: Final = 300_000
GROWN_NS: Final = 4_000 * NS_PER_MS


@dataclass(frozen=True, slots=True, kw_only=True)
class Impairment:
    """What is wrong with a link; shares from 0 to 1. `paths`: beginnings of topics, none: all.

    `growth`: since `since_ns` the delay grows by this share of the time, as behind a queue that
    fills; up to GROWN_NS.
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
        return not self.paths or path.startswith(self.paths)


class Link:
    """The way from one host to another."""

    def __init__(self) -> None:
        self.impairments: tuple[tuple[Impairment, Random], ...] = ()
        self.delay_ns = USUAL_DELAY_NS

    def add(self, impairment: Impairment, salt: int) -> None:
        self.impairments = (*self.impairments, (impairment, Random(salt)))

    def remove(self, impairment: Impairment) -> None:
        self.impairments = tuple(
            (one, random) for one, random in self.impairments if one is not impairment
        )

    @property
    def cut(self) -> bool:
        return any(one.loss >= 1.0 and not one.paths for one, _ in self.impairments)

    def arrivals_ns(self, path: str, now_ns: int) -> list[int]:
        """After how long each copy of a frame arrives; none: it is lost."""
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


class Network:
    """All links, and who is connected to whom."""

    def __init__(self, scheduler: Scheduler) -> None:
        self.scheduler = scheduler
        self._links: dict[tuple[str, str], Link] = {}
        self.born_ns: dict[str, int] = {}
        self.sent = 0

    def link(self, source: str, target: str) -> Link:
        link = self._links.get((source, target))
        if link is None:
            link = self._links[source, target] = Link()
        return link

    def connected(self, source: Host, target: Host) -> bool:
        """Whether frames go from one to the other: both are there and have dialled."""
        return source.alive and target.alive and not self.link(source.name, target.name).cut

    def send(
        self, source: Host, target: Host, path: str, action: Callable[..., object], *arguments: Any
    ) -> None:
        """Have `action` called at the target when the frame arrives there, if it does."""
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
