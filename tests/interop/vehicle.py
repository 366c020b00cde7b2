"""The robot under test: plant, robot and gateway as processes, behind a relay."""

import socket
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

from checks.harness.relays import PERFECT, POOR, Impairment, UdpRelay
from tests.support.stack.processes import Crew, Running

LINES: dict[str, Impairment] = {"clean": PERFECT, "poor": POOR}
RECORDING_BYTES = 9_001
"""Not a whole number of packets of LOG_DATA."""


class RobotOnAir(NamedTuple):
    """Where clients reach the robot, its recording, and the process of the gateway."""

    port: int
    recording: Path
    gateway: Running


@contextmanager
def robot_on_air(folder: Path, line: str, seed: int) -> Iterator[RobotOnAir]:
    """Run a robot in a room with a gateway, which clients reach over a line.

    Time is paced, as it is with `sidestep up`: a busy computer slows the robot down, and does not
    stop it in a failsafe.
    """
    recordings = folder / "recordings"
    recordings.mkdir()
    recording = recordings / "20261123T120000Z-r1.tlog"
    recording.write_bytes(bytes(n * n % 251 for n in range(RECORDING_BYTES)))
    port = free_udp_port()
    with Crew() as crew:
        crew.robot("--lockstep")
        crew.plant("--lockstep", "--speed", "1")
        endpoint = f"udpin:127.0.0.1:{port}"
        gateway = crew.dialling("run", "gateway", endpoint, "--recordings", str(recordings))
        gateway.says("is MAVLink system")
        with UdpRelay(("127.0.0.1", port), LINES[line], seed) as relay:
            yield RobotOnAir(relay.port, recording, gateway)


def free_udp_port() -> int:
    """Return a loopback port that no process uses at the moment."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
    return port
