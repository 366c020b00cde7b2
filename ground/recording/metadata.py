"""Gather what a recording holds besides frames: the world, the parameters, and the build."""

import os
import subprocess
from collections.abc import Callable
from importlib import metadata
from pathlib import Path
from typing import Final

from ground.client.emergency_stop import ServiceCaller
from protocol.topics import DIALECT, PARAMETERS, WORLD, Service
from runtime.cli import compiled
from runtime.errors import RemoteError
from runtime.watchdog import slowdown

WANTED: Final[dict[str, Service]] = {"parameters": PARAMETERS, "world": WORLD}
PATIENCE_S: Final = 0.2
"""For an answer on an idle machine: the frames that arrive meanwhile wait in memory."""
LAST_PATIENCE_S: Final = 1.0
"""At the end of a recording, when there is no later try."""
FIRST_PAUSE_NS: Final = 200_000_000
LONGEST_PAUSE_NS: Final = 5_000_000_000


class MetadataReader:
    """Requests missing facts at growing intervals, as the plant may start later."""

    def __init__(
        self, bus: ServiceCaller, robot: str, slowdown: Callable[[], float] = slowdown
    ) -> None:
        self._bus = bus
        self._robot = robot
        self._slowdown = slowdown
        self._missing = dict(WANTED)
        self._due_ns = 0
        self._pause_ns = FIRST_PAUSE_NS

    def poll(self, now_ns: int) -> dict[str, str]:
        """Return newly received facts as JSON texts by name; request those that are due."""
        if not self._missing or now_ns < self._due_ns:
            return {}
        self._due_ns = now_ns + self._pause_ns
        self._pause_ns = min(2 * self._pause_ns, LONGEST_PAUSE_NS)
        return self._request(PATIENCE_S)

    def request_missing(self) -> dict[str, str]:
        """Request all missing facts a last time; return the received ones as `poll` does."""
        return self._request(LAST_PATIENCE_S)

    def _request(self, patience_s: float) -> dict[str, str]:
        found = {}
        for name, service in tuple(self._missing.items()):
            text = self._answer(service, patience_s * self._slowdown())
            if text is not None:
                found[name] = text
                del self._missing[name]
        return found

    def _answer(self, service: Service, patience_s: float) -> str | None:
        try:
            answer = self._bus.ask(service, timeout_s=patience_s, robot=self._robot)
            return answer.decode() if isinstance(answer, bytes) else None
        except (RemoteError, UnicodeDecodeError):
            return None


ROOT: Final = Path(__file__).parents[2]
UNKNOWN: Final = "unknown"
GIT_TIMEOUT_S: Final = 10.0


def build() -> dict[str, str]:
    """Return version, commit and dialect for the header of a recording."""
    return {"version": version_of("sidestep"), "commit": commit(), "dialect": DIALECT}


def version_of(package: str) -> str:
    """Return the installed version of a package."""
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return UNKNOWN


def commit() -> str:
    """Return the commit of the checkout, else the one that was compiled, else "unknown".

    A `+` at its end means that tracked files have changes.
    """
    if not (ROOT / ".git").exists():
        return compiled.commit()
    head = git("rev-parse", "HEAD")
    changed = "+" if git("status", "--porcelain", "--untracked-files=no") else ""
    return f"{head}{changed}" if head else UNKNOWN


def git(*words: str) -> str | None:
    """Return the output of git, or None when git fails or is not installed."""
    try:
        run = subprocess.run(
            ["git", "-C", str(ROOT), *words],
            capture_output=True,
            text=True,
            timeout=GIT_TIMEOUT_S,
            check=True,
            env={**os.environ, "GIT_OPTIONAL_LOCKS": "0"},
        )
    except (OSError, subprocess.SubprocessError):
        return None
    return run.stdout.strip()
