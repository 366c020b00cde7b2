"""Real processes around a router, each behind a cable of its own, started and ended by role."""

import json
import os
import resource
import signal
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import IO, Any, Final, Self

from ground.launch.child_command import command
from verification.harness.certificates import made_keys
from verification.harness.processes import free_port
from verification.harness.tcp_proxy import TcpProxy
from verification.harness.until import PATIENCE_S, until

LAST_WORDS: Final = 300
CERTIFICATES: Final = {"robot": "robot-r1"}
BURNS: Final = (sys.executable, "-c", "while True: pass")


class Crew:
    """`afflictions`: what happens to a role when it is told to, as `afflicted` reads it.

    `locked`: everybody has a certificate, and `keys` is the folder of them; else it is None.
    """

    def __init__(
        self, afflictions: Mapping[str, Mapping[str, Any]], *, locked: bool = False
    ) -> None:
        self.router = f"{'tls' if locked else 'tcp'}/127.0.0.1:{free_port()}"
        self.truth = self.router if locked else f"tcp/127.0.0.1:{free_port()}"
        """Where the truth can be heard: at the plant, which no certificate allows to be dialled."""
        self.keys: Path | None = None
        self._locked = locked
        self.cables: dict[str, TcpProxy] = {}
        self._afflictions = afflictions
        self._words: dict[str, Sequence[str]] = {}
        self._processes: dict[str, subprocess.Popen[bytes]] = {}
        self._outputs: dict[str, IO[bytes]] = {}
        self._scope = ExitStack()

    def __enter__(self) -> Self:
        self.folder = Path(self._scope.enter_context(tempfile.TemporaryDirectory()))
        if self._locked:
            self.keys = made_keys(self.folder / "keys")
        return self

    def __exit__(self, *_: object) -> None:
        for role in self._processes:
            self.kill(role)
        self._scope.close()

    def start(self, role: str, *words: str) -> None:
        """`sidestep` with these words; without words, as it was started before."""
        if words:
            self._words[role] = [*words, *self._config(role)]
        afflicted = self._afflictions.get(role)
        line = command(self._words[role], os.getpid())
        if afflicted is not None:
            module = (sys.executable, "-m", "verification.faults_matrix.fault_hook")
            line = [*module, str(os.getpid()), json.dumps(afflicted), *self._words[role]]
        self._execute(role, line)

    def _config(self, role: str) -> Sequence[str]:
        if self.keys is None:
            return ()
        return "--config", str(self.keys / f"{CERTIFICATES.get(role, role)}.toml")

    def burn(self) -> None:
        """One process per core that does nothing but use it."""
        for number in range(len(os.sched_getaffinity(0))):
            self._execute(f"burner {number}", BURNS)

    def dialling(self, role: str, *words: str) -> None:
        """Through a cable of its own."""
        cable = self.cables[role] = self._scope.enter_context(TcpProxy(self.router))
        self.start(role, *words, "--connect", cable.endpoint)

    def says(self, role: str, words: str) -> None:
        """Wait until it has said that; RuntimeError with what it did say when it does not."""
        until(lambda: words in self.said(role) or not self.lives(role), f"{role}: {words}")
        if words not in self.said(role):
            raise RuntimeError(f"the {role} ended: {self.last_words(role)}")

    def said(self, role: str) -> str:
        return os.pread(self._outputs[role].fileno(), 1 << 20, 0).decode(errors="replace")

    def last_words(self, role: str) -> str:
        """The end of what it said; empty when it was never started."""
        return self.said(role)[-LAST_WORDS:] if role in self._outputs else ""

    def lives(self, role: str) -> bool:
        return role in self._processes and self._processes[role].poll() is None

    def send(self, role: str, number: signal.Signals) -> None:
        self._processes[role].send_signal(number)

    def limit(self, role: str, what: int, size: int) -> None:
        """From now on it gets no more of this than so much."""
        resource.prlimit(self._processes[role].pid, what, (size, size))

    def memory(self, role: str) -> int:
        """Bytes of address space that it has."""
        pages = Path(f"/proc/{self._processes[role].pid}/statm").read_text(encoding="utf-8")
        return int(pages.split()[0]) * resource.getpagesize()

    def kill(self, role: str) -> None:
        self._processes[role].kill()
        self._processes[role].wait()

    def ends(self, role: str, within_s: float = PATIENCE_S) -> None:
        """It was told to; one that does not is killed."""
        try:
            self._processes[role].wait(within_s)
        except subprocess.TimeoutExpired:
            self.kill(role)

    def _execute(self, role: str, line: Sequence[str]) -> None:
        output = tempfile.TemporaryFile()  # noqa: SIM115 - closed on the way out
        self._scope.callback(output.close)
        self._outputs[role] = output
        self._processes[role] = subprocess.Popen(
            line, stdin=subprocess.DEVNULL, stdout=output, stderr=output, start_new_session=True
        )
