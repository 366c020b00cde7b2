"""Supervise the processes started by `up`: restart after an exit or a hang.

Exits alone decide which process is restarted, when, and when no longer. A process that runs but is
silent hangs or is suspended.

All messages pass the hub: the router, or the robot where there is no router. So a silence is
attributed to the hub first. A process that waits for a processor is slow and does not hang.
"""

import signal
from collections import deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Final, NamedTuple

from ground.launch.child_processes import Children, exit_description
from runtime.units import NS_PER_MS, NS_PER_S
from runtime.watchdog import HANGS, MAX_SLOWDOWN, starved_ns


class RestartPolicy(NamedTuple):
    """The first restart is immediate; each further one within `window_ns` waits twice as long."""

    pause_ns: int = 200 * NS_PER_MS
    longest_ns: int = 2 * NS_PER_S
    limit: int = 5
    window_ns: int = 60 * NS_PER_S


class DueRestart(NamedTuple):
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

    def due(self, now_ns: int) -> list[DueRestart]:
        """Return the restarts that are due, each once."""
        now = [
            DueRestart(role, cause)
            for role, (at_ns, cause) in self._planned.items()
            if at_ns <= now_ns
        ]
        for restart in now:
            del self._planned[restart.role]
        return now


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


SETTLED_NS: Final = 2_000_000_000
"""Time after a restart until the messages about it have arrived and are recorded."""
RESTART_WAIT_NS: Final = 8_000_000_000
INTERNAL_ERROR: Final = "internal error: "
RESTARTS: Final = "ends for a restart on request"
"""The last line of output of a robot process after an operator has requested a restart."""
MAX_CAUSE_CHARS: Final = 200


class VoidRun(NamedTuple):
    """Why a trial is void. `is_final`: no further message about it is expected."""

    why: str
    is_final: bool


class Supervisor:
    """Checks all processes in rounds; `arguments_of` maps a role and a cause to a command line."""

    def __init__(
        self,
        children: Children,
        schedule: RestartSchedule,
        detector: HangDetector | None,
        arguments_of: Callable[[str, str], list[str]],
    ) -> None:
        """Create a supervisor; without a `detector` it notices exits only."""
        self.schedule = schedule
        self._children = children
        self._detector = detector
        self._arguments_of = arguments_of
        self._hung: dict[str, str] = {}
        self._ended: dict[str, tuple[str, int]] = {}
        self._events: deque[str] = deque()

    def round(self, now_ns: int) -> None:
        """Check every process once: kill those that hang, restart those that are due."""
        detector = self._detector
        for role in detector.silent(now_ns) if detector else []:
            if detector and self._children.send(role, signal.SIGKILL):
                self._hung[role] = detector.cause
        for role, code, words in self._children.take_exited():
            cause = self._hung.pop(role, "") or cause_of(role, code, words)
            self._ended[role] = (cause, now_ns)
            self._events.append(self.schedule.record_exit(role, cause, now_ns))
            if self._detector:
                self._detector.note_exit(role)
        for role, cause in self.schedule.due(now_ns):
            self._children.start(role, self._arguments_of(role, cause))
            if self._detector:
                self._detector.note_start(role, now_ns)

    def next_event(self) -> str:
        """Return the next event in words; empty when there is none."""
        return self._events.popleft() if self._events else ""

    def void(self, roles: Sequence[str], now_ns: int) -> VoidRun | None:
        """Return why a trial that needs these roles is void; None while it counts."""
        for role in roles:
            if role in self._ended:
                return self._void(role, *self._ended[role], now_ns)
        return None

    def _void(self, role: str, cause: str, at_ns: int, now_ns: int) -> VoidRun:
        why = f"the {role} process {cause}"
        if role in self.schedule.given_up:
            return VoidRun(f"{why} and is given up", is_final=True)
        back = self._detector is not None and self._detector.last_message_ns(role) is not None
        if back:
            return VoidRun(
                f"{why}; it is back, but with a fresh state", now_ns - at_ns > SETTLED_NS
            )
        return VoidRun(f"{why} and has not come back", now_ns - at_ns > RESTART_WAIT_NS)


def cause_of(role: str, code: int, words: str) -> str:
    """Return how a process ended, from its exit code and the end of its output."""
    if code == -signal.SIGALRM:
        return HANGS
    if code < 0:
        return f"was killed ({exit_description(code)})"
    lines = [line.strip() for line in words.splitlines() if line.strip()]
    for line in lines:
        if INTERNAL_ERROR in line:
            core = "a core exception" if role.startswith("robot") else "an exception"
            return f"ended by {core} ({line.partition(INTERNAL_ERROR)[2]})"[:MAX_CAUSE_CHARS]
    if lines and lines[-1].endswith(RESTARTS):
        return RESTARTS.replace("ends", "ended")
    last = f": {lines[-1]}" if lines else ""
    return f"exited unexpectedly ({exit_description(code)}{last})"[:MAX_CAUSE_CHARS]
