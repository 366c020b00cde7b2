"""Real processes around a router, each behind a TCP proxy, started and ended by role."""

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

from checks.harness.processes import free_port, made_keys
from checks.harness.relays import TcpProxy
from checks.harness.until import PATIENCE_S, until
from ground.launch.child_command import command
from runtime.cli.verb_table import with_present_name

LAST_OUTPUT: Final = 300
CERTIFICATES: Final = {"robot": "robot-r1"}
BURNS: Final = (sys.executable, "-c", "while True: pass")


class ProcessGroup:
    """The processes of a stack.

    `injections` are the faults that a role injects into itself on SIGUSR1. With `locked`, access is
    controlled, and `keys` is the folder of the certificates; else `keys` is None.
    """

    def __init__(
        self, injections: Mapping[str, Mapping[str, Any]], *, locked: bool = False
    ) -> None:
        self.router = f"{'tls' if locked else 'tcp'}/127.0.0.1:{free_port()}"
        self.truth = self.router if locked else f"tcp/127.0.0.1:{free_port()}"
        """Endpoint of the truth: the plant, or the router if access control forbids that."""
        self.keys: Path | None = None
        self._locked = locked
        self.proxies: dict[str, TcpProxy] = {}
        self._injections = injections
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
        """Run `sidestep` with these words, or with those of the last start."""
        if words:
            self._words[role] = [*words, *self._config(role)]
        injection = self._injections.get(role)
        line = command(self._words[role], os.getpid())
        if injection is not None:
            module = (sys.executable, "-m", "checks.faults.fault_hook")
            present = with_present_name(self._words[role])
            line = [*module, str(os.getpid()), json.dumps(injection), *present]
        self._execute(role, line)

    def _config(self, role: str) -> Sequence[str]:
        if self.keys is None:
            return ()
        return "--config", str(self.keys / f"{CERTIFICATES.get(role, role)}.toml")

    def burn(self) -> None:
        """Start one process per core that only uses the processor."""
        for number in range(len(os.sched_getaffinity(0))):
            self._execute(f"burner {number}", BURNS)

    def start_behind_proxy(self, role: str, *words: str) -> None:
        """Start a process that connects to the router through a proxy."""
        proxy = self.proxies[role] = self._scope.enter_context(TcpProxy(self.router))
        self.start(role, *words, "--connect", proxy.endpoint)

    def await_output(self, role: str, words: str) -> None:
        """Wait until a process has written `words`; RuntimeError when it ends before."""
        until(lambda: words in self.output(role) or not self.is_running(role), f"{role}: {words}")
        if words not in self.output(role):
            raise RuntimeError(f"the {role} ended: {self.last_output(role)}")

    def output(self, role: str) -> str:
        """Return the output of a process."""
        return os.pread(self._outputs[role].fileno(), 1 << 20, 0).decode(errors="replace")

    def last_output(self, role: str) -> str:
        """Return the end of the output; empty if the process was never started."""
        return self.output(role)[-LAST_OUTPUT:] if role in self._outputs else ""

    def is_running(self, role: str) -> bool:
        """Return whether a process is running."""
        return role in self._processes and self._processes[role].poll() is None

    def send(self, role: str, number: signal.Signals) -> None:
        """Send a signal."""
        self._processes[role].send_signal(number)

    def limit(self, role: str, what: int, size: int) -> None:
        """Limit a resource of a process to `size` from now on."""
        resource.prlimit(self._processes[role].pid, what, (size, size))

    def memory(self, role: str) -> int:
        """Return the size of the address space in bytes."""
        pages = Path(f"/proc/{self._processes[role].pid}/statm").read_text(encoding="utf-8")
        return int(pages.split()[0]) * resource.getpagesize()

    def kill(self, role: str) -> None:
        """Kill a process and wait for its end."""
        self._processes[role].kill()
        self._processes[role].wait()

    def await_end(self, role: str, within_s: float = PATIENCE_S) -> None:
        """Wait for the end of a process; kill it after `within_s`."""
        try:
            self._processes[role].wait(within_s)
        except subprocess.TimeoutExpired:
            self.kill(role)

    def _execute(self, role: str, line: Sequence[str]) -> None:
        output = tempfile.TemporaryFile()  # noqa: SIM115 - closed when the group ends
        self._scope.callback(output.close)
        self._outputs[role] = output
        self._processes[role] = subprocess.Popen(
            line, stdin=subprocess.DEVNULL, stdout=output, stderr=output, start_new_session=True
        )
