"""Supervise the processes started by `up`: restart after an exit or a hang."""

import signal
from collections import deque
from collections.abc import Callable, Sequence
from typing import Final, NamedTuple

from ground.launch.child_processes import Children, exit_description
from ground.launch.hang_detector import HangDetector
from ground.launch.restart_policy import RestartSchedule
from runtime.watchdog import HANGS

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
