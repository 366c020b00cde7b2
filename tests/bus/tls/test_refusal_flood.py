"""A session that is refused can neither fill the log of the listener nor put words into it."""

import subprocess
import sys
from pathlib import Path

import pytest

LISTENER = """
import os, sys, time
from pathlib import Path
import zenoh
from protocol.bus.bus import open_bus
from protocol.bus.audit import audited_connections
from protocol.bus.session import configured
from protocol.bus.network import Network
from protocol.topics import Role
from tests.support.keyring import Keyring

def caught():
    # Bytes of the files in memory that this process has open.
    files = [Path(f"/proc/self/fd/{n}") for n in range(100)]
    return sum(f.stat().st_size for f in files if f.is_symlink() and "memfd" in os.readlink(f))

ring, told, largest = Keyring(Path(sys.argv[1])), [], 0
listening = Network(listen=("tls/127.0.0.1:0",), robots=("r1",), tls=ring.tls("robot-r1"))
with open_bus(listening, Role.ROBOT, "r1") as bus, audited_connections(bus, told.append):
    endpoint = bus.locator()
    dialling = Network(
        mode="client", connect=(endpoint,), robots=("r1",), tls=ring.tls("viewer"))
    with zenoh.open(configured(dialling, 2.0)) as viewer:
        until_s = time.monotonic() + 60.0
        for number in range(int(sys.argv[3])):
            key = sys.argv[2].format(zid=bus.zid) * int(sys.argv[4])
            viewer.put(f"sidestep/r1/tlm/{number}{key}", b"x",
                       congestion_control=zenoh.CongestionControl.BLOCK)
            largest = max(largest, caught() if number % 20 == 0 else 0)
        while not told and time.monotonic() < until_s:
            time.sleep(0.01)
sys.stderr.write("".join(f"{line}\\n" for line in told))
print(largest)
"""


def told(folder: Path, key: str, times: int, length: int) -> tuple[str, int]:
    """Return the log of a listener, and the most bytes of in-memory files that it held."""
    done = subprocess.run(
        [sys.executable, "-c", LISTENER, str(folder / "ring"), key, str(times), str(length)],
        capture_output=True,
        text=True,
        timeout=180.0,
        check=False,
        env={"PYTHONPATH": ":".join(sys.path)},
    )
    assert done.returncode == 0, done.stderr[-1000:]
    return done.stderr, int(done.stdout)


def test_flood_of_long_keys_costs_bounded_log_and_memory(tmp_path: Path) -> None:
    log, held_bytes = told(tmp_path, "x", 300, 60_000)
    assert "refused: viewer" in log
    assert len(log) < 10_000
    assert held_bytes < 1_000_000


FORGED = (
    "2026-11-21T22:13:59.056613Z TRACE  rx-0 ThreadId(09) "
    "zenoh::net::routing::interceptor::access_control: Using cached result: {zid} is unauthorized "
    "to Put (ingress) on sidestep/r1/srv/command"
)


@pytest.mark.parametrize("between", ["\n", " ", ""])
def test_viewer_cannot_write_a_refusal_of_another_session(tmp_path: Path, between: str) -> None:
    log, _ = told(tmp_path, f"{between}{FORGED}{between}", 1, 1)
    assert log.startswith("refused: viewer at 127.0.0.1:")
    assert log.count("\n") == log.count("refused: ") == 1
    assert " may not put on sidestep/r1/srv/command" not in log
