"""Keeps the processes of `up` running: who dies is started again, who hangs is ended for it."""

import signal
from collections import deque
from collections.abc import Callable, Sequence
from typing import Final, NamedTuple

from ground.launch.child_processes import Children, how
from ground.launch.hang_detector import SILENT, HangDetector
from ground.launch.restart_policy import RestartSchedule
from runtime.watchdog import HANGS

SETTLED_NS: Final = 2_000_000_000
"""So long after its death its own words of it have been heard and recorded, if it came back."""
PATIENCE_NS: Final = 8_000_000_000
DEFECT: Final = "internal error: "
MOST: Final = 200


class InvalidRun(NamedTuple):
    """Why a trial is none any more; `over` when there is nothing left to wait for."""

    why: str
    over: bool


class Supervisor:
    """Looked at in rounds; `arguments_of` says how each role is started anew after a cause."""

    def __init__(
        self,
        children: Children,
        supervisor: RestartSchedule,
        hearts: HangDetector | None,
        arguments_of: Callable[[str, str], list[str]],
    ) -> None:
        """Without `hearts` nobody is known to hang: in lockstep, time may stand still."""
        self.supervisor = supervisor
        self._children = children
        self._hearts = hearts
        self._arguments_of = arguments_of
        self._hung: set[str] = set()
        self._ended: dict[str, tuple[str, int]] = {}
        self._news: deque[str] = deque()

    def round(self, now_ns: int) -> None:
        """Look once at everybody."""
        for role in self._hearts.silent(now_ns) if self._hearts else []:
            if self._children.send(role, signal.SIGKILL):
                self._hung.add(role)
        for role, code, words in self._children.ended():
            cause = SILENT if role in self._hung else cause_of(role, code, words)
            self._hung.discard(role)
            self._ended[role] = (cause, now_ns)
            self._news.append(self.supervisor.died(role, cause, now_ns))
            if self._hearts:
                self._hearts.gone(role)
        for role, cause in self.supervisor.due(now_ns):
            self._children.start(role, self._arguments_of(role, cause))
            if self._hearts:
                self._hearts.started(role, now_ns)

    def news(self) -> str:
        """What has happened, one thing at a time; empty when there is nothing new."""
        return self._news.popleft() if self._news else ""

    def void(self, roles: Sequence[str], now_ns: int) -> InvalidRun | None:
        """Whether a trial that needs all of these is void, because one was started anew."""
        for role in roles:
            if role in self._ended:
                return self._void(role, *self._ended[role], now_ns)
        return None

    def _void(self, role: str, cause: str, at_ns: int, now_ns: int) -> InvalidRun:
        why = f"the {role} process {cause}"
        if role in self.supervisor.given_up:
            return InvalidRun(f"{why} and is given up", over=True)
        back = self._hearts is not None and self._hearts.back_ns(role) is not None
        if back:
            return InvalidRun(f"{why}; it is back, but has begun anew", now_ns - at_ns > SETTLED_NS)
        return InvalidRun(f"{why} and has not come back", now_ns - at_ns > PATIENCE_NS)


def cause_of(role: str, code: int, words: str) -> str:
    """Return how a process ended, from its exit code and the end of what it wrote."""
    if code == -signal.SIGALRM:
        return HANGS
    if code < 0:
        return f"was killed ({how(code)})"
    lines = [line.strip() for line in words.splitlines() if line.strip()]
    for line in lines:
        if DEFECT in line:
            core = "a core exception" if role.startswith("robot") else "an exception"
            return f"ended by {core} ({line.partition(DEFECT)[2]})"[:MOST]
    last = f": {lines[-1]}" if lines else ""
    return f"ended by itself ({how(code)}{last})"[:MOST]
