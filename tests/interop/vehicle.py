"""The robots under test: plant, robots and gateway as processes, behind a relay."""

import json
import socket
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from hashlib import sha256
from pathlib import Path
from typing import Any, Final, NamedTuple

import pytest

from checks.built import ROOT
from checks.harness.crew import Crew
from checks.harness.processes import Running, free_port
from checks.harness.relays import PERFECT, POOR, Impairment, UdpRelay

LINES: dict[str, Impairment | None] = {"clean": PERFECT, "poor": POOR, "tcp": None}
"""UDP through a relay with these properties, or TCP, which repeats by itself what a line loses."""
RECORDING_BYTES = 9_001
"""Not a whole number of packets of LOG_DATA."""


class RobotOnAir(NamedTuple):
    """Where clients reach the robot, its recording, and the process of the gateway.

    `transport` is `tcp`, `udpout`, or `udpin` for a port at which the client waits.
    """

    transport: str
    port: int
    recording: Path
    gateway: Running


@contextmanager
def robot_on_air(folder: Path, line: str, seed: int, *, listens: bool) -> Iterator[RobotOnAir]:
    """Run a robot in a room with a gateway, which a client reaches over a line; or, if it listens
    and uses UDP, the gateway reaches it.

    Time is paced, as it is with `sidestep up`: a busy computer slows the robot down, and does not
    stop it in a failsafe.
    """
    recordings = folder / "recordings"
    recordings.mkdir()
    recording = recordings / "20261123T120000Z-r1.tlog"
    recording.write_bytes(bytes(n * n % 251 for n in range(RECORDING_BYTES)))
    impairment = LINES[line]
    kind = socket.SOCK_STREAM if impairment is None else socket.SOCK_DGRAM
    port = free_port(kind)
    transport, client_port, endpoint = "tcp", port, f"tcpin:127.0.0.1:{port}"
    with Crew() as crew, ExitStack() as scope:
        crew.robot("--lockstep")
        crew.plant("--lockstep", "--speed", "1")
        if impairment is not None:
            relay = scope.enter_context(UdpRelay(("127.0.0.1", port), impairment, seed))
            transport, client_port, endpoint = "udpout", relay.port, f"udpin:127.0.0.1:{port}"
            if listens:
                transport, client_port, endpoint = "udpin", port, f"udpout:127.0.0.1:{relay.port}"
        gateway = crew.dialling("run", "gateway", endpoint, "--recordings", str(recordings))
        gateway.says("is MAVLink system")
        yield RobotOnAir(transport, client_port, recording, gateway)


YARD: Final = """
name = "yard"
size_m = [12.0, 12.0]
start = { x_m = 6.0, y_m = 2.0, heading_deg = 90.0 }
goal = { x_m = 6.0, y_m = 11.0 }
"""
"""Free space ahead, where the judge drives; the second robot starts beside the first."""
START: Final = ("--start", "6", "2", "90")
BESIDE: Final = ("--start", "5.4", "2", "90")
RESULTS: Final = ROOT / "build" / "interop" / "rows"


class Judged(NamedTuple):
    """Where the judge reaches the robots, and the file with the key of the line."""

    crew: Crew
    endpoint: str
    key: Path
    gateway: Running

    def holds_key(self, path: Path) -> bool:
        """Return True if a file contains the key, in any form."""
        passphrase = self.key.read_bytes()
        data = path.read_bytes()
        return any(one in data for one in (passphrase, sha256(passphrase).digest()))


@contextmanager
def two_robots(folder: Path, kind: str, patch: pytest.MonkeyPatch) -> Iterator[Judged]:
    """Run two robots with a gateway at one endpoint, `udp` or `tcp`."""
    for name in ("STATE", "CONFIG", "DATA"):
        patch.setenv(f"XDG_{name}_HOME", str(folder / name.lower()))
    recordings = folder / "recordings"
    recordings.mkdir()
    recording = recordings / "20261123T120000Z-r1.tlog"
    recording.write_bytes(bytes(n * n % 251 for n in range(RECORDING_BYTES)))
    port = free_port(socket.SOCK_DGRAM)
    with Crew() as crew:
        for words in (("new",), ("show", "--secret")):
            keys = crew.start("keys", "signing", *words)
            assert keys.ends() == 0, keys.said
        key = folder / "key"
        key.write_text(keys.said.split()[-1], encoding="utf-8")
        world = folder / "yard.toml"
        world.write_text(YARD, encoding="utf-8")
        first = crew.listening("robot", "--state", str(folder / "r1"), *START)
        first.says("ready")
        second = crew.dialling("robot", "--id", "r2", "--state", str(folder / "r2"), *BESIDE)
        second.says("ready")
        plant = crew.dialling(
            "plant", "--world", str(world), "--robots", "r1,r2", "--noise", "none"
        )
        plant.says("plant: world")
        crew.in_real_time()
        gateway = crew.dialling(
            "run", "gateway", f"{kind}in:127.0.0.1:{port},require", "--robots", "r1,r2",
            "--recordings", str(recordings), "--record", str(recordings),
        )  # fmt: skip
        gateway.says("r2 is MAVLink system 2")
        way = "udpout" if kind == "udp" else "tcp"
        yield Judged(crew, f"{way}:127.0.0.1:{port}", key, gateway)


def verdicts(judged: Judged, *words: str, within_s: float) -> dict[str, Any]:
    """Let the judge check the robots; return its JSON."""
    judge = judged.crew.start("mavlink", "check", judged.endpoint, "--json", *words)
    judge.ends(within_s)
    lines = [line for line in judge.said.splitlines() if line.startswith("{")]
    assert lines, judge.said
    found: dict[str, Any] = json.loads(lines[-1])
    return found


def keep(name: str, found: dict[str, Any]) -> None:
    """Keep the verdicts for the table of the documentation."""
    RESULTS.mkdir(parents=True, exist_ok=True)
    text = json.dumps(found, indent=1, ensure_ascii=False)
    (RESULTS / f"{name}.json").write_text(text + "\n", encoding="utf-8")
