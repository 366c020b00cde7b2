"""The rate of long transfers to each client: parameter lists, files and logs share one budget."""

from collections.abc import Mapping
from typing import Final

from runtime.units import NS_PER_S

FAST_BYTES_S: Final = 250_000
"""Limit for a line without its own; a client in Python reads more than twice as fast."""
LINE_SHARE: Final = 0.3
"""The part of a slow line that transfers may use; at 57,600 baud the streams take half of it."""
FULL_NS: Final = 60_000_000
"""Unused budget is kept for this time."""


class Pacing:
    """Budgets in bytes.

    `lines` holds the capacity of each client's line, None if it has no limit.
    """

    def __init__(self, lines: Mapping[int, int | None]) -> None:
        self._lines = lines
        self._budgets: dict[int, tuple[float, int]] = {}

    def take(self, client: int, size: int, now_ns: int) -> bool:
        """Return whether bytes may be sent now, and subtract them from the budget."""
        line_bytes_s = self._lines.get(client)
        rate = FAST_BYTES_S if line_bytes_s is None else line_bytes_s * LINE_SHARE
        full = rate * FULL_NS / NS_PER_S
        left, since_ns = self._budgets.get(client, (full, now_ns))
        left = min(full, left + rate * (now_ns - since_ns) / NS_PER_S)
        # The budget may become negative, so that slow lines also carry long messages.
        may = left > 0
        self._budgets[client] = (left - size if may else left, now_ns)
        return may

    def forget(self, client: int) -> None:
        """Drop the budget of a client that has disconnected."""
        self._budgets.pop(client, None)
