"""The streams of one client: their rates, within the capacity of its line."""

from typing import Final

from gateways.mavlink.catalogue import Catalogue
from runtime.units import NS_PER_MS, NS_PER_S

ROUND_NS: Final = 50 * NS_PER_MS
"""Shortest time between two messages of a stream: the robot sends telemetry at 20 Hz."""
EARLY_NS: Final = 10 * NS_PER_MS
"""A stream is sent up to this time before it is due, so that jitter does not skip a message."""
PHASE_NS: Final = 20 * NS_PER_MS
MAX_HZ: Final = NS_PER_S / ROUND_NS
STREAMS_SHARE: Final = 0.9
"""The part of a line that streams may use; answers and texts use the rest."""


class ClientStreams:
    """Rates of one client. On a line that is too slow, all are lowered by the same factor."""

    def __init__(self, catalogue: Catalogue, line_bytes_s: int | None, now_ns: int) -> None:
        self._catalogue = catalogue
        self._limit_bytes_s = None if line_bytes_s is None else line_bytes_s * STREAMS_SHARE
        self._defaults_hz = {source.number: source.rate_hz for source in catalogue}
        if self._limit_bytes_s is not None and self._cost(self._defaults_hz) > self._limit_bytes_s:
            self._defaults_hz = {source.number: source.slow_hz for source in catalogue}
        self._wanted_hz = dict(self._defaults_hz)
        self._periods_ns: dict[int, int] = {}
        self._due_ns: dict[int, int] = {}
        self._next_ns = now_ns
        self.shortest_ns = NS_PER_S
        self._plan(now_ns)

    def set(self, number: int, rate_hz: float, now_ns: int) -> None:
        """Change the rate of a message; 0 ends it."""
        self._wanted_hz[number] = min(rate_hz, MAX_HZ)
        self._plan(now_ns)

    def set_group(self, group: int | None, rate_hz: float, now_ns: int) -> None:
        """Change the rate of all messages of a group, or of every group if it is None."""
        for source in self._catalogue:
            if source.group is not None and group in (None, source.group):
                self._wanted_hz[source.number] = min(rate_hz, MAX_HZ)
        self._plan(now_ns)

    def reset(self, number: int, now_ns: int) -> None:
        """Return a message to its default rate."""
        self.set(number, self._defaults_hz.get(number, 0.0), now_ns)

    def period_ns(self, number: int) -> int:
        """Return the time between two messages; 0 if it is not sent."""
        return self._periods_ns.get(number, 0)

    def hurry(self, number: int, now_ns: int) -> None:
        """Make a message due now, if it is sent to the client at all."""
        if number in self._due_ns:
            self._due_ns[number] = self._next_ns = now_ns

    def take(self, now_ns: int) -> list[int]:
        """Return the messages that are due. A missed message is skipped."""
        until_ns = now_ns + EARLY_NS
        if until_ns < self._next_ns:
            return []
        found = []
        for number, due_ns in self._due_ns.items():
            if due_ns <= until_ns:
                found.append(number)
                period_ns = self._periods_ns[number]
                next_ns = due_ns + period_ns
                self._due_ns[number] = next_ns if next_ns > now_ns else now_ns + period_ns
        self._next_ns = min(self._due_ns.values(), default=now_ns + NS_PER_S)
        return found

    def _plan(self, now_ns: int) -> None:
        """Spread the streams over the rounds; those whose period stays keep their phase."""
        factor = 1.0
        if self._limit_bytes_s is not None:
            factor = max(1.0, self._cost(self._wanted_hz) / self._limit_bytes_s)
        running = {number: rate_hz for number, rate_hz in self._wanted_hz.items() if rate_hz > 0}
        for number in set(self._due_ns) - set(running):
            del self._due_ns[number], self._periods_ns[number]
        for place, (number, rate_hz) in enumerate(running.items()):
            period_ns = round(NS_PER_S * factor / rate_hz)
            if self._periods_ns.get(number) != period_ns:
                self._periods_ns[number] = period_ns
                self._due_ns[number] = now_ns + place * PHASE_NS % period_ns
        self._next_ns = now_ns
        self.shortest_ns = min(self._periods_ns.values(), default=NS_PER_S)

    def _cost(self, rates_hz: dict[int, float]) -> float:
        """Return the bytes per second of all streams, at most."""
        found = 0.0
        for number, rate_hz in rates_hz.items():
            source = self._catalogue.find(number)
            found += 0.0 if source is None else rate_hz * source.largest_bytes
        return found
