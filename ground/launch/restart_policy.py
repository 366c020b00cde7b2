"""Who is started again, when, and when no more: decided from deaths alone, without a process."""

from collections.abc import Iterable
from typing import NamedTuple

from runtime.units import NS_PER_MS, NS_PER_S


class RestartPolicy(NamedTuple):
    """The first restart is at once; each further one within `window_ns` waits twice as long."""

    pause_ns: int = 200 * NS_PER_MS
    longest_ns: int = 2 * NS_PER_S
    limit: int = 5
    window_ns: int = 60 * NS_PER_S


class Restart(NamedTuple):
    """Due now: who, and how the one before ended."""

    role: str
    cause: str


class RestartSchedule:
    """Fed with deaths; `due` says whom to start now."""

    def __init__(self, roles: Iterable[str], policy: RestartPolicy | None = None) -> None:
        self._policy = policy or RestartPolicy()
        self._planned: dict[str, tuple[int, str]] = {}
        self._deaths: dict[str, list[int]] = {role: [] for role in roles}
        self.given_up: dict[str, str] = {}
        """Who is not started again, and what was said of it."""

    def died(self, role: str, cause: str, now_ns: int) -> str:
        """What has happened and what is done about it, in words."""
        policy = self._policy
        recent = [at_ns for at_ns in self._deaths[role] if now_ns - at_ns < policy.window_ns]
        self._deaths[role] = [*recent, now_ns]
        self._planned.pop(role, None)
        what = f"the {role} process {cause}"
        if len(recent) >= policy.limit:
            times, seconds = len(recent) + 1, policy.window_ns // NS_PER_S
            self.given_up[role] = f"GIVEN UP: {what}, {times} times within {seconds} s"
            return self.given_up[role]
        pause_ns = 0
        if recent:
            pause_ns = min(policy.longest_ns, policy.pause_ns << (len(recent) - 1))
        self._planned[role] = (now_ns + pause_ns, cause)
        return f"{what}; it is started again{f' in {pause_ns / NS_PER_S:g} s' if pause_ns else ''}"

    def due(self, now_ns: int) -> list[Restart]:
        """Each restart once, when its time has come."""
        now = [
            Restart(role, cause)
            for role, (at_ns, cause) in self._planned.items()
            if at_ns <= now_ns
        ]
        for restart in now:
            del self._planned[restart.role]
        return now
