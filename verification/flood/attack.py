"""An attacker on a robot's bus as a process, and whoever starts it.

`python -m verification.flood.attack KIND RATE ENDPOINT [FOLDER ROLE]` says `ready`. Told `go` on
its standard input it begins, told `hold` it pauses, and at the end of it says what it has sent.
FOLDER and ROLE are the certificate it has, on an open bus none.
"""

import json
import os
import subprocess
import sys
import tempfile
import threading
from collections.abc import Sequence
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Final, Self

from protocol.bus.network import Network
from protocol.bus.tls.access import operator_name
from runtime.clock import WallClock
from runtime.units import NS_PER_S
from verification.flood.kinds import KINDS, Attacker, Kind, Shoot
from verification.flood.relay import SlowRelay
from verification.harness.observer import tls_of

TURN_S: Final = 0.005
BURST_S: Final = 0.1
"""At most so much is made up for at once."""

ACCEPTED: Final = "accepted"
LAST_S: Final = 20.0
LAST_WORDS: Final = 500


class Door:
    """How an attacker gets in: an endpoint, and with `keys` the certificate of a role."""

    def __init__(self, endpoint: str, keys: Path | None = None, role: str = "") -> None:
        self.endpoint, self.keys, self.role = endpoint, keys, role

    @property
    def words(self) -> list[str]:
        return [self.endpoint, *([str(self.keys), self.role] if self.keys else [])]

    def network(self, endpoint: str | None = None) -> Network:
        tls = None if self.keys is None else tls_of(self.keys, self.role)
        return Network(mode="client", connect=(endpoint or self.endpoint,), tls=tls)

    @property
    def name(self) -> str:
        """The operator's name that its certificate allows, or one that it has made up."""
        return operator_name(self.role if self.keys else None) or "eve"


class Attack:
    """A running attacker; it has a lower priority, for elsewhere it would not be on this machine.

    Once it has ended, `told` is what it has sent and what came back, and `accepted` counts the
    answers that something was acted upon, by the slice of time.
    """

    def __init__(self, kind: str, door: Door, rate_hz: float | None = None) -> None:
        self.kind, self.door = kind, door
        self.told: dict[str, object] = {}
        self.accepted: dict[int, int] = {}
        self.errors = ""
        rate = str(KINDS[kind].rate_hz if rate_hz is None else rate_hz)
        words = [sys.executable, "-m", "verification.flood.attack", kind, rate, *door.words]
        self._errors = tempfile.TemporaryFile()  # noqa: SIM115 - closed when it ends
        self._child = subprocess.Popen(
            ["nice", *words],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._errors,
            text=True,
        )
        assert self._child.stdout is not None
        if "ready" not in self._child.stdout.readline():
            self.end()
            raise RuntimeError(f"the attacker ({kind}) did not get in: {self.errors}")

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.end()

    def go(self) -> None:
        self._tell("go")

    def hold(self) -> None:
        self._tell("hold")

    def end(self) -> None:
        """Have it say what it has sent; one that does not is killed."""
        try:
            said, _ = self._child.communicate(timeout=LAST_S)
        except subprocess.TimeoutExpired:
            self._child.kill()
            said, _ = self._child.communicate()
        if said:
            self.told = json.loads(said)
            accepted = self.told.pop(ACCEPTED, {})
            assert isinstance(accepted, dict)
            self.accepted = {int(number): answers for number, answers in accepted.items()}
        self.errors = os.pread(self._errors.fileno(), 1 << 20, 0).decode()[-LAST_WORDS:]
        self._errors.close()

    def _tell(self, word: str) -> None:
        assert self._child.stdin is not None
        with suppress(BrokenPipeError):
            self._child.stdin.write(f"{word}\n")
            self._child.stdin.flush()


class Gate:
    """What the attacker is told: to go, to hold, and by the end of its input to end."""

    def __init__(self) -> None:
        self.open = threading.Event()
        self.over = False

    def obey(self) -> None:
        for line in sys.stdin:
            if line.strip() == "go":
                self.open.set()
            else:
                self.open.clear()
        self.over = True
        self.open.set()


def fire(shoot: Shoot, rate_hz: float, gate: Gate) -> int:
    """Shoot at that rate while the gate is open; how often, when it is told to end."""
    clock, fired = WallClock(), 0
    while not gate.over:
        gate.open.wait()
        begun_ns, shot = clock.now_ns(), 0
        while gate.open.is_set() and not gate.over:
            due = round((clock.now_ns() - begun_ns) / NS_PER_S * rate_hz)
            for _ in range(min(due - shot, max(1, round(rate_hz * BURST_S)))):
                shoot()
                fired += 1
            shot = due
            clock.sleep_until(clock.now_ns() + round(TURN_S * NS_PER_S))
    return fired


def sessions(kind: Kind, door: Door, scope: ExitStack) -> list[Attacker]:
    endpoint = door.endpoint
    if kind.bytes_per_s:
        endpoint = scope.enter_context(SlowRelay(endpoint, kind.bytes_per_s)).endpoint
    return [Attacker(door.network(endpoint), door.name) for _ in range(kind.sessions)]


def main(arguments: Sequence[str]) -> None:
    name, rate_hz, endpoint, *locked = arguments
    door = Door(endpoint, Path(locked[0]), locked[1]) if locked else Door(endpoint)
    kind, gate = KINDS[name], Gate()
    with ExitStack() as scope:
        first, *others = sessions(kind, door, scope)
        shoot = kind.prepare(first)
        print("ready", flush=True)
        threading.Thread(target=gate.obey, daemon=True).start()
        fired = fire(shoot, float(rate_hz), gate)
        answers = {**first.answers, ACCEPTED: first.accepted}
        print(json.dumps({"sent": fired, **answers}), flush=True)
        for attacker in (first, *others):
            attacker.close()


if __name__ == "__main__":
    main(sys.argv[1:])
