"""Decide from exits alone which process is restarted, when, and when no longer."""

from collections.abc import Iterable
from typing import NamedTuple

from runtime.units import NS_PER_MS, NS_PER_S


class RestartPolicy(NamedTuple):
    """The first restart is immediate; each further one within `window_ns` waits twice as long."""

    pause_ns: int = 200 * NS_PER_MS
    longest_ns: int = 2 * NS_PER_S
    limit: int = 5
    window_ns: int = 60 * NS_PER_S


class Restart(NamedTuple):
    """A restart that is due, and how the previous process ended."""

    role: str
    cause: str


class RestartSchedule:
    """Schedules restarts from reported exits."""

    def __init__(self, roles: Iterable[str], policy: RestartPolicy | None = None) -> None:
        self._policy = policy or RestartPolicy()
        self._planned: dict[str, tuple[int, str]] = {}
        self._exits: dict[str, list[int]] = {role: [] for role in roles}
        self.given_up: dict[str, str] = {}
        """Message for each role that is no longer restarted."""

    def record_exit(self, role: str, cause: str, now_ns: int) -> str:
        """Schedule a restart after an exit; return what happened and what follows, in words."""
        policy = self._policy
        recent = [at_ns for at_ns in self._exits[role] if now_ns - at_ns < policy.window_ns]
        self._exits[role] = [*recent, now_ns]
        self._planned.pop(role, None)
        what = f"the {role} process {cause}"
        if len(recent) >= policy.limit:
            times, seconds = len(recent) + 1, policy.window_ns // NS_PER_S
            self.given_up[role] = (
                f"GIVEN UP: {what}, {times} times within {seconds} s; it stays stopped"
            )
            return self.given_up[role]
        pause_ns = 0
        if recent:
            pause_ns = min(policy.longest_ns, policy.pause_ns << (len(recent) - 1))
        self._planned[role] = (now_ns + pause_ns, cause)
        return f"{what}; restarting{f' in {pause_ns / NS_PER_S:g} s' if pause_ns else ''}"

    def due(self, now_ns: int) -> list[Restart]:
        """Return the restarts that are due, each once."""
        now = [
            Restart(role, cause)
            for role, (at_ns, cause) in self._planned.items()
            if at_ns <= now_ns
        ]
        for restart in now:
            del self._planned[restart.role]
        return now
