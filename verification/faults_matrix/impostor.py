"""A process in the place of a router, with the key of another robot."""

from pathlib import Path
from typing import Final, Self

from protocol.bus.network import Network
from verification.flood.kinds import Attacker, frames, questions, wheels
from verification.harness.processes import free_port, tls_of

NAME: Final = "robot-r2"
KINDS: Final = (frames, questions, wheels)


class Impostor:
    """Listens as a router does, without access control of its own."""

    def __init__(self, keys: Path) -> None:
        self.endpoint = f"tls/127.0.0.1:{free_port()}"
        network = Network(mode="router", listen=(self.endpoint,), tls=tls_of(keys, NAME))
        self._attacker = Attacker(network, "ground")
        self._senders = [prepare(self._attacker) for prepare in KINDS]

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._attacker.close()

    def send(self) -> None:
        """Send one of each kind of payload that could make a robot drive."""
        for send in self._senders:
            send()
