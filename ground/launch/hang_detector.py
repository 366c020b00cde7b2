"""Who has fallen silent although its process is there: it hangs, or is stopped.

A silence is laid to the hub first, through which all others are heard: the router, or the robot
where there is none.
"""

from collections.abc import Callable, Iterable
from typing import Final

from runtime.units import NS_PER_MS, NS_PER_S

SILENT_NS: Final = 2_500 * NS_PER_MS
STARTING_NS: Final = 15 * NS_PER_S
"""As long as this may pass from a start to the first sign of life."""
ECHO_NS: Final = 100 * NS_PER_MS
"""What comes so soon after a start was still on its way from the one before."""
DEAF_NS: Final = 500 * NS_PER_MS
"""Who has not looked for so long has not listened either."""
ROUTER: Final = "router"
SILENT: Final = f"hung (not heard for {SILENT_NS / NS_PER_S:g} s)"


class HangDetector:
    """`heard` may be called from any thread, everything else from one."""

    def __init__(
        self, hub: str, roles: Iterable[str], linked: Callable[[], bool], now_ns: int
    ) -> None:
        """`roles` are those with a heart, which beats; a router has none and is known by `linked`:
        is there a link at all?"""
        self._hub = hub
        self._linked = linked
        self._heard = dict.fromkeys(roles, now_ns)
        self._started = dict.fromkeys(self._heard, now_ns - 2 * ECHO_NS)
        self._gone: set[str] = set()
        self._looked_ns = self._listening_ns = now_ns

    def heard(self, role: str, now_ns: int) -> None:
        self._heard[role] = now_ns

    def back_ns(self, role: str) -> int | None:
        """When it was heard last; None: not since it was started again."""
        heard_ns = self._heard[role]
        there = role not in self._gone and heard_ns - self._started[role] > ECHO_NS
        return heard_ns if there else None

    def gone(self, role: str) -> None:
        """It has ended, so its silence needs no explanation."""
        self._gone.add(role)

    def started(self, role: str, now_ns: int) -> None:
        """It is there again; with a hub all the others have to find it first."""
        self._gone.discard(role)
        for one in self._heard if role == self._hub else [role]:
            if one in self._heard:
                self._started[one] = now_ns

    def silent(self, now_ns: int) -> list[str]:
        """Those that hang, each once until it was started again."""
        if now_ns - self._looked_ns > DEAF_NS:  # it was us who hung, or were stopped
            self._listening_ns = now_ns
        self._looked_ns = now_ns
        if self._hub in self._gone:
            return []
        overdue = [role for role in self._heard if self._overdue(role, now_ns)]
        if self._hub in overdue or (overdue and self._hub == ROUTER and not self._linked()):
            overdue = [self._hub]
        self._gone.update(overdue)
        return overdue

    def _overdue(self, role: str, now_ns: int) -> bool:
        if role in self._gone:
            return False
        heard_ns = self.back_ns(role)
        if heard_ns is None:
            return now_ns - max(self._started[role], self._listening_ns) > STARTING_NS
        return now_ns - max(heard_ns, self._listening_ns) > SILENT_NS
