"""Detect processes that are running but silent: they hang or are suspended.

All messages pass the hub: the router, or the robot where there is no router. So a silence is
attributed to the hub first. A process that waits for a processor is slow and does not hang.
"""

from collections.abc import Callable, Iterable, Mapping
from typing import Final

from runtime.units import NS_PER_MS, NS_PER_S
from runtime.watchdog import MAX_SLOWDOWN, starved_ns

SILENT_NS: Final = 2_500 * NS_PER_MS
PACED_SILENT_NS: Final = 4_500 * NS_PER_MS
"""In paced time lateness is no safety event, and after a restart the robot's position is unknown.

Longer than the plant of an idle machine waits for a silent robot (3 s), and shorter than the
watchdog of each process (5 s), so that the cause of the restart is the same in both clocks.
"""
SLOW_NS: Final = 3 * NS_PER_S
"""Added for roles that send only once a second."""
STARTING_NS: Final = 15 * NS_PER_S
"""Longest time from a start to the first message."""
STALE_MESSAGE_NS: Final = 100 * NS_PER_MS
"""A message that arrives this soon after a restart was sent by the previous process."""
OWN_SUSPENSION_NS: Final = 500 * NS_PER_MS
"""If the monitor itself was suspended this long, ignore the silence."""
READ_NS: Final = 200 * NS_PER_MS
"""Silence from which on the waits of a process for a processor are read."""
ROUTER: Final = "router"


class HangDetector:
    """`received` may be called from any thread, everything else from one."""

    def __init__(
        self,
        hub: str,
        roles: Iterable[str],
        linked: Callable[[], bool],
        now_ns: int,
        silent_ns: int = SILENT_NS,
        slow: Iterable[str] = (),
        queued_ns: Callable[[str], Mapping[str, int]] = lambda _: {},
    ) -> None:
        """Create a detector for `roles`, which publish a heartbeat; `silent_ns` without one hang.

        A router publishes no heartbeat; `linked` returns whether any link is up. The roles in
        `slow` send once a second. `queued_ns` returns how long each thread of a role's process has
        waited for a processor: so much of a silence does not count.
        """
        slow = tuple(slow)
        self._queued_ns = queued_ns
        self._queued_at: dict[str, tuple[int, Mapping[str, int]]] = {}
        self.cause = f"hung (silent for {silent_ns / NS_PER_S:g} s)"
        self._silent_ns = silent_ns
        self._hub = hub
        self._linked = linked
        self._slow = frozenset(slow)
        self._messages_ns = dict.fromkeys((*roles, *slow), now_ns)
        self._started = dict.fromkeys(self._messages_ns, now_ns - 2 * STALE_MESSAGE_NS)
        self._exited: set[str] = set()
        self._last_check_ns = self._listening_since_ns = now_ns

    def note_message(self, role: str, now_ns: int) -> None:
        """Note a message of a process."""
        if role in self._messages_ns:
            self._messages_ns[role] = now_ns

    def last_message_ns(self, role: str) -> int | None:
        """Return the time of the last message, or None if there is none since the restart."""
        message_ns = self._messages_ns[role]
        is_back = role not in self._exited and message_ns - self._started[role] > STALE_MESSAGE_NS
        return message_ns if is_back else None

    def note_exit(self, role: str) -> None:
        """Note that a process has exited, so its silence is explained."""
        self._exited.add(role)

    def note_start(self, role: str, now_ns: int) -> None:
        """Note that a process was restarted; when the hub restarts, all others must reconnect."""
        self._exited.discard(role)
        for one in self._messages_ns if role == self._hub else [role]:
            if one in self._messages_ns:
                self._started[one] = now_ns

    def silent(self, now_ns: int) -> list[str]:
        """Return the roles that hang, each once until it is restarted."""
        if now_ns - self._last_check_ns > OWN_SUSPENSION_NS:  # this process was suspended
            self._listening_since_ns = now_ns
        self._last_check_ns = now_ns
        if self._hub in self._exited:
            return []
        overdue = [role for role in self._messages_ns if self._overdue(role, now_ns)]
        if self._hub in overdue or (overdue and self._hub == ROUTER and not self._linked()):
            overdue = [self._hub]
        self._exited.update(overdue)
        return overdue

    def _overdue(self, role: str, now_ns: int) -> bool:
        if role in self._exited:
            return False
        message_ns = self.last_message_ns(role)
        if message_ns is None:
            return now_ns - max(self._started[role], self._listening_since_ns) > STARTING_NS
        limit_ns = self._silent_ns + (SLOW_NS if role in self._slow else 0)
        since_ns = max(message_ns, self._listening_since_ns)
        return now_ns - since_ns - self._starved_ns(role, since_ns, now_ns) > limit_ns

    def _starved_ns(self, role: str, since_ns: int, now_ns: int) -> int:
        """Return how long a silent process has waited for a processor, up to a limit.

        Some of its threads may wait although the one that sends hangs.
        """
        if now_ns - since_ns < READ_NS:
            return 0
        queued_ns = self._queued_ns(role)
        at_ns, before = self._queued_at.get(role, (None, queued_ns))
        if at_ns != since_ns:
            self._queued_at[role] = since_ns, queued_ns
            return 0
        longest_ns = round((MAX_SLOWDOWN - 1.0) * self._silent_ns)
        return min(starved_ns(before, queued_ns), longest_ns)
