"""Request what a recording holds besides frames: the world and the parameters, once each."""

from collections.abc import Callable
from typing import Final

from ground.client.emergency_stop import ServiceCaller
from protocol.topics import PARAMETERS, WORLD, Service
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
