"""Request what a recording holds besides frames: the world and the parameters, once each."""

from typing import Final

from ground.client.emergency_stop import ServiceCaller
from protocol.topics import PARAMETERS, WORLD, Service
from runtime.errors import RemoteError

WANTED: Final[dict[str, Service]] = {"parameters": PARAMETERS, "world": WORLD}
PATIENCE_S: Final = 0.2
FIRST_PAUSE_NS: Final = 200_000_000
LONGEST_PAUSE_NS: Final = 5_000_000_000


class MetadataReader:
    """Requests missing facts at growing intervals, as the plant may start later."""

    def __init__(self, bus: ServiceCaller, robot: str) -> None:
        self._bus = bus
        self._robot = robot
        self._missing = dict(WANTED)
        self._due_ns = 0
        self._pause_ns = FIRST_PAUSE_NS

    def poll(self, now_ns: int) -> dict[str, str]:
        """Return newly received facts as JSON texts by name; request those that are due."""
        if not self._missing or now_ns < self._due_ns:
            return {}
        self._due_ns = now_ns + self._pause_ns
        self._pause_ns = min(2 * self._pause_ns, LONGEST_PAUSE_NS)
        return self.request_missing()

    def request_missing(self) -> dict[str, str]:
        """Request all missing facts now; return the received ones as JSON texts by name."""
        found = {}
        for name, service in tuple(self._missing.items()):
            text = self._answer(service)
            if text is not None:
                found[name] = text
                del self._missing[name]
        return found

    def _answer(self, service: Service) -> str | None:
        try:
            answer = self._bus.ask(service, timeout_s=PATIENCE_S, robot=self._robot)
            return answer.decode() if isinstance(answer, bytes) else None
        except (RemoteError, UnicodeDecodeError):
            return None
