"""Attackers as processes: on a robot's bus, and strangers without a certificate.

`python -m checks.flood.attackers KIND RATE ENDPOINT [FOLDER ROLE]` prints `ready`. It attacks after
the line `go` on its standard input, pauses after `hold`, and prints a summary when its input ends.
FOLDER and ROLE name the attacker's certificate; on an open bus it has none. Strangers make
connections that become no link, and forge stop datagrams.
"""

import json
import os
import socket
import ssl
import subprocess
import sys
import tempfile
import threading
from collections import deque
from collections.abc import Mapping, Sequence
from contextlib import ExitStack, suppress
from pathlib import Path
from time import monotonic
from types import MappingProxyType
from typing import Final, Self

from checks.flood.attack_kinds import KINDS, Attacker, AttackKind, Send
from checks.harness.processes import tls_of
from checks.harness.relays import SlowRelay, address_of
from protocol.bus.network import Network
from protocol.bus.rights import operator_name
from protocol.stop_datagram import Press, sealed_press
from runtime.clock import WallClock
from runtime.units import NS_PER_S

TURN_S: Final = 0.005
MAX_SILENT: Final = 500
DATAGRAMS: Final = "datagrams"


def tls_hello() -> bytes:
    """Return the first bytes of a TLS client."""
    client = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    client.check_hostname, client.verify_mode = False, ssl.CERT_NONE
    out = ssl.MemoryBIO()
    with suppress(ssl.SSLWantReadError):
        client.wrap_bio(ssl.MemoryBIO(), out).do_handshake()
    return out.read()


GREETINGS: Final[Mapping[str, bytes]] = MappingProxyType(
    {
        "garbage": b"this is no TLS 123",
        "http": b"GET / HTTP/1.1\r\nHost: robot\r\n\r\n",
        "hello": tls_hello(),
        "silent": b"",
        DATAGRAMS: sealed_press(b"guessed", "r1", Press("anna", 0, 1)),
    }
)
"""What a stranger sends first. All close at once but the silent ones, which stay."""


RATES_HZ: Final[Mapping[str, float]] = MappingProxyType(
    {"garbage": 100.0, "http": 100.0, "silent": 100.0, DATAGRAMS: 1000.0}
)
"""The strangers of `bench flood`, with how often they call."""

SOURCE: Final = "127.0.0.2"


class Strangers:
    """Dials an endpoint at a rate from an address, until the block ends; `called` counts."""

    def __init__(self, endpoint: str, way: str, rate_hz: float, source: str) -> None:
        self.called = 0
        self._place, self._source = address_of(endpoint), source
        self._greeting, self._rate_hz = GREETINGS[way], rate_hz
        self._type = socket.SOCK_DGRAM if way == DATAGRAMS else socket.SOCK_STREAM
        self._kept: deque[socket.socket] = deque(maxlen=MAX_SILENT)
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._over.set()
        self._thread.join()
        for one in self._kept:
            one.close()

    def _run(self) -> None:
        begun_s = monotonic()
        while not self._over.wait(TURN_S):
            for _ in range(int((monotonic() - begun_s) * self._rate_hz) - self.called):
                self._call()
                self.called += 1

    def _call(self) -> None:
        one = socket.socket(type=self._type)
        one.setblocking(False)  # an unanswered connection must not delay the next
        with suppress(OSError):
            one.bind((self._source, 0))
            one.connect_ex(self._place)
            if self._greeting:
                one.send(self._greeting)
            else:
                self._kept.append(one)
                return
        one.close()


BURST_S: Final = 0.1
"""At most this much delay is made up for at once."""

ACCEPTED: Final = "accepted"
LAST_S: Final = 20.0
LAST_WORDS: Final = 500


class Access:
    """The endpoint that an attacker connects to, and with `keys` the certificate of a role."""

    def __init__(self, endpoint: str, keys: Path | None = None, role: str = "") -> None:
        self.endpoint, self.keys, self.role = endpoint, keys, role

    @property
    def words(self) -> list[str]:
        """The command line arguments of this access."""
        return [self.endpoint, *([str(self.keys), self.role] if self.keys else [])]

    def network(self, endpoint: str | None = None) -> Network:
        """Return the network settings of a client, for another `endpoint` if given."""
        tls = None if self.keys is None else tls_of(self.keys, self.role)
        return Network(mode="client", connect=(endpoint or self.endpoint,), tls=tls)

    @property
    def name(self) -> str:
        """The operator name that the certificate allows; a made-up one without a certificate."""
        return operator_name(self.role if self.keys else None) or "eve"


class Attack:
    """A running attacker process.

    It runs at a lower priority because a real attacker would use another machine. After its end,
    `summary` counts what it sent and the answers, and `accepted` counts the answers that accepted
    a command, by time slice.
    """

    def __init__(self, kind: str, access: Access, rate_hz: float | None = None) -> None:
        self.kind, self.access = kind, access
        self.summary: dict[str, object] = {}
        self.accepted: dict[int, int] = {}
        self.errors = ""
        rate = str(KINDS[kind].rate_hz if rate_hz is None else rate_hz)
        words = [sys.executable, "-m", "checks.flood.attackers", kind, rate, *access.words]
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
            raise RuntimeError(f"the attacker ({kind}) did not connect: {self.errors}")

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.end()

    def go(self) -> None:
        """Begin or resume the attack."""
        self._send("go")

    def hold(self) -> None:
        """Pause the attack."""
        self._send("hold")

    def end(self) -> None:
        """End the process and read its summary; kill a process that does not end."""
        try:
            output, _ = self._child.communicate(timeout=LAST_S)
        except subprocess.TimeoutExpired:
            self._child.kill()
            output, _ = self._child.communicate()
        if output:
            self.summary = json.loads(output)
            accepted = self.summary.pop(ACCEPTED, {})
            assert isinstance(accepted, dict)
            self.accepted = {int(number): answers for number, answers in accepted.items()}
        self.errors = os.pread(self._errors.fileno(), 1 << 20, 0).decode()[-LAST_WORDS:]
        self._errors.close()

    def _send(self, word: str) -> None:
        assert self._child.stdin is not None
        with suppress(BrokenPipeError):
            self._child.stdin.write(f"{word}\n")
            self._child.stdin.flush()


class AttackControl:
    """The commands that the attacker process has received: go, hold, or the end of its input."""

    def __init__(self) -> None:
        self.on = threading.Event()
        self.over = False

    def read_commands(self) -> None:
        """Read commands from standard input until it ends."""
        for line in sys.stdin:
            if line.strip() == "go":
                self.on.set()
            else:
                self.on.clear()
        self.over = True
        self.on.set()


def run_attack(send: Send, rate_hz: float, control: AttackControl) -> int:
    """Send at a rate while the attack is on; return how often, when the attacker must end."""
    clock, total = WallClock(), 0
    while not control.over:
        control.on.wait()
        begun_ns, sent = clock.now_ns(), 0
        while control.on.is_set() and not control.over:
            due = round((clock.now_ns() - begun_ns) / NS_PER_S * rate_hz)
            for _ in range(min(due - sent, max(1, round(rate_hz * BURST_S)))):
                send()
                total += 1
            sent = due
            clock.sleep_until(clock.now_ns() + round(TURN_S * NS_PER_S))
    return total


def open_sessions(kind: AttackKind, access: Access, scope: ExitStack) -> list[Attacker]:
    """Open the sessions of an attack, through a slow relay if its kind reads slowly."""
    endpoint = access.endpoint
    if kind.bytes_per_s:
        endpoint = scope.enter_context(SlowRelay(endpoint, kind.bytes_per_s)).endpoint
    return [Attacker(access.network(endpoint), access.name) for _ in range(kind.sessions)]


def main(arguments: Sequence[str]) -> None:
    """Attack according to the arguments until standard input ends, then print the summary."""
    name, rate_hz, endpoint, *locked = arguments
    access = Access(endpoint, Path(locked[0]), locked[1]) if locked else Access(endpoint)
    kind, control = KINDS[name], AttackControl()
    with ExitStack() as scope:
        first, *others = open_sessions(kind, access, scope)
        send = kind.prepare(first)
        print("ready", flush=True)
        threading.Thread(target=control.read_commands, daemon=True).start()
        sent = run_attack(send, float(rate_hz), control)
        answers = {**first.answers, ACCEPTED: first.accepted}
        print(json.dumps({"sent": sent, **answers}), flush=True)
        for attacker in (first, *others):
            attacker.close()


if __name__ == "__main__":
    main(sys.argv[1:])
