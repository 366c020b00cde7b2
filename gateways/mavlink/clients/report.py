"""The state of the gateway for the bus: the totals of its clients, once a second."""

from collections.abc import Iterable
from typing import Final, NamedTuple

from gateways.mavlink.clients.client_link import ClientLink
from gateways.mavlink.control import Owner
from protocol.wire.messages import GatewayStatus
from runtime.units import NS_PER_S

PERIOD_NS: Final = NS_PER_S
LARGEST: Final = 0xFFFF_FFFF


class Totals(NamedTuple):
    """Counters of all clients, including those that have disconnected."""

    received: int = 0
    lost: int = 0
    malformed: int = 0
    refused: int = 0


class Reporter:
    """Counts the traffic of all vehicles, and reports it for each one."""

    def __init__(self, now_ns: int) -> None:
        self._due_ns = self._since_ns = now_ns
        self._gone = Totals()
        self._before = Totals()
        self._sent_bytes: dict[int, int] = {}

    def sent(self, system: int, size: int) -> None:
        """Count a frame of a vehicle."""
        self._sent_bytes[system] = self._sent_bytes.get(system, 0) + size

    def left(self, link: ClientLink) -> None:
        """Keep the counters of a client that has disconnected."""
        self._gone = _sum(self._gone, _totals(link))

    def is_due(self, now_ns: int) -> bool:
        """Return whether a second is over."""
        return now_ns >= self._due_ns

    def take(
        self, links: Iterable[ClientLink], owners: dict[int, Owner | None], now_ns: int
    ) -> list[GatewayStatus]:
        """Return the state of each vehicle, by its system id, since the last call."""
        links = list(links)
        seconds = max(now_ns - self._since_ns, 1) / NS_PER_S
        totals = self._gone
        for link in links:
            totals = _sum(totals, _totals(link))
        received = totals.received - self._before.received
        lost = max(0, totals.lost - self._before.lost)  # overtaken frames are subtracted later
        found = [
            GatewayStatus(
                time_ns=0,
                sent_bytes_s=min(LARGEST, round(self._sent_bytes.get(system, 0) / seconds)),
                refused=totals.refused & LARGEST,
                malformed=totals.malformed & LARGEST,
                received_hz=min(0xFFFF, round(received / seconds)),
                lost_permille=round(1000 * lost / max(1, lost + received)),
                system=system,
                clients=min(0xFF, len(links)),
                signing=min(0xFF, sum(1 for link in links if link.signing.signed)),
                owner=0 if owner is None else owner.system,
            )
            for system, owner in owners.items()
        ]
        self._before, self._sent_bytes = totals, {}
        self._since_ns, self._due_ns = now_ns, now_ns + PERIOD_NS
        return found


def _totals(link: ClientLink) -> Totals:
    return Totals(link.received, link.lost, link.malformed, link.signing.refused)


def _sum(one: Totals, other: Totals) -> Totals:
    return Totals(*(a + b for a, b in zip(one, other, strict=True)))
