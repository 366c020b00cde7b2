"""Processes of the stack for a measurement: ports, certificates, CPU time and memory of them."""

import os
import socket
import subprocess
import sys
import threading
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Final, NamedTuple

from protocol.bus.network import Network, Tls
from protocol.outcome import start_arguments
from protocol.world import World

VALID: Final = timedelta(days=1)

ROBOT: Final = "r1"


class Started:
    """A process that has reported to be ready; `output` is what it wrote until then.

    Later output is read and dropped, so that the process never blocks on a full pipe.
    """

    def __init__(self, child: "subprocess.Popen[str]", ready: str) -> None:
        self.pid = child.pid
        self.output: list[str] = []
        assert child.stderr is not None
        for line in child.stderr:
            self.output.append(line.rstrip())
            if ready in line:
                break
        else:
            raise RuntimeError("a process ended before it was ready: " + " ".join(self.output))
        self._reader = threading.Thread(target=deque, args=(child.stderr, 0), daemon=True)
        self._reader.start()

    def join(self) -> None:
        """Wait until the process has closed its output."""
        self._reader.join()


@contextmanager
def sidestep(
    *arguments: str,
    ready: str,
    environment: Mapping[str, str] | None = None,
    program: Sequence[str] = ("sidestep",),
) -> Iterator[Started]:
    """Run `sidestep ...` until the block ends; a line with `ready` reports that it is ready.

    `environment` is added to that of this process. `program`: another module to run in its place,
    with its first arguments.
    """
    command = [sys.executable, "-m", *program, *arguments]
    variables = {**os.environ, **(environment or {})}
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True, env=variables) as child:
        started = None
        try:
            started = Started(child, ready)
            yield started
        finally:
            child.terminate()
            if started is not None:
                started.join()


class RobotProcess(NamedTuple):
    """A `sidestep run robot` process, and the network settings that reach it."""

    pid: int
    output: list[str]
    network: Network


@contextmanager
def robot_process(
    world: World, *options: str, keys: Path | None = None, client: str = "router"
) -> Iterator[RobotProcess]:
    """Run a robot at the start of a world.

    With `keys`, a folder of `sidestep keys new`, access is controlled, and `client` is the role
    whose certificate `network` has. The router's certificate allows the plant and the operator.
    """
    endpoint = f"{'tls' if keys else 'tcp'}/127.0.0.1:{free_port()}"
    start = start_arguments(world.start.x_m, world.start.y_m, world.start.heading_rad)
    locked = ("--config", str(keys / f"robot-{ROBOT}.toml")) if keys else ()
    arguments = (
        "run",
        "robot",
        "--id",
        ROBOT,
        "--listen",
        endpoint,
        "--start",
        *start,
        *options,
        *locked,
    )
    with sidestep(*arguments, ready="ready") as robot:
        tls = tls_of(keys, client) if keys else None
        network = Network(mode="client", connect=(endpoint,), tls=tls)
        yield RobotProcess(robot.pid, robot.output, network)


def tls_of(keys: Path, role: str) -> Tls:
    """Return the certificate of a role, out of a folder of `sidestep keys new`."""
    certificate, key = str(keys / f"{role}.pem"), str(keys / f"{role}.key")
    return Tls(ca=str(keys / "ca.pem"), certificate=certificate, key=key)


def free_port() -> int:
    """Return a loopback port that no process uses at the moment."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
    return port


def made_keys(folder: Path, operators: Sequence[str] = ()) -> Path:
    """Create a folder of certificates for the robots r1 and r2, valid for a day, and return it."""
    # Imported here because other measurements run without its library.
    from ground.certificates.folder import make

    now = datetime.now(UTC)
    make(folder, ["r1", "r2"], {}, now - VALID, now + VALID, operators)
    return folder


def cpu_s(pid: int) -> float:
    """Return the user and system time of all threads of a process so far."""
    fields = Path(f"/proc/{pid}/stat").read_text(encoding="utf-8").rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def resident_mb(pid: int) -> float:
    """Return the resident memory of a process in MiB."""
    for line in Path(f"/proc/{pid}/status").read_text(encoding="utf-8").splitlines():
        if line.startswith("VmRSS:"):
            return int(line.split()[1]) / 1024
    raise RuntimeError(f"process {pid} has no resident memory")
