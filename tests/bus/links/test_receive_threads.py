"""Zenoh's receive thread: few of them, and each keeps its Python state from call to call."""

import os
import subprocess
import sys
import threading

import pytest

from protocol.bus.bus import open_bus
from protocol.bus.network import Network
from protocol.bus.tuning.receive_threads import RUNTIMES, VARIABLE, use_few_threads
from protocol.topics import ODOMETRY, Role
from protocol.wire.messages import PlanarOdometry
from tests.support.until import until

FRAMES = 5
THREADS = """
import os
from pathlib import Path
from protocol.bus.bus import open_bus
from protocol.bus.network import Network
from protocol.topics import Role
from tests.support.until import until
def names():
    return sorted((task / "comm").read_text().strip() for task in Path("/proc/self/task").iterdir())
with open_bus(Network(listen=("tcp/127.0.0.1:0",)), Role.ROBOT, "r1") as robot:
    with open_bus(Network(mode="client", connect=(robot.locator(),)), Role.PLANT, "r1") as plant:
        until(lambda: "tx-0" in names(), what="the sending thread")
        print(*names())
"""


class Calls(threading.local):
    """The number of calls that the Python state of this thread has seen."""

    seen = 0


def odometry(number: int) -> PlanarOdometry:
    return PlanarOdometry(
        time_ns=number, x_m=0.0, y_m=0.0, heading_rad=0.0, speed_m_s=0.0, yaw_rate_rad_s=0.0,
        cov_xx_m2=0.0, cov_xy_m2=0.0, cov_xh_m_rad=0.0, cov_yy_m2=0.0, cov_yh_m_rad=0.0,
        cov_hh_rad2=0.0,
    )  # fmt: skip


def test_a_receive_thread_keeps_its_python_state() -> None:
    calls, counts = Calls(), []

    def receive(_key: str, _frame: bytes, _arrived_ns: int) -> None:
        calls.seen += 1
        counts.append(calls.seen)

    with (
        open_bus(Network(listen=("tcp/127.0.0.1:0",)), Role.ROBOT, "r1") as robot,
        open_bus(Network(mode="client", connect=(robot.locator(),)), None, "r1") as viewer,
    ):
        viewer.stream(ODOMETRY, receive)
        publisher = robot.publisher(ODOMETRY)
        assert robot.await_matched([publisher], 5.0) == []
        for number in range(FRAMES):
            publisher.put(odometry(number))
        until(lambda: len(counts) == FRAMES, what="all frames")
    assert counts == list(range(1, FRAMES + 1))


def test_one_thread_receives_and_another_sends() -> None:
    done = subprocess.run(
        [sys.executable, "-c", THREADS], stdout=subprocess.PIPE, text=True, check=True
    )
    names = done.stdout.split()
    assert not [name for name in names if name.startswith(("rx-", "acc-", "net-"))]
    assert {"app-0", "tx-0"} <= set(names)


def test_a_configured_environment_is_respected(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(VARIABLE, "(rx: (worker_threads: 4))")
    use_few_threads()
    assert os.environ[VARIABLE] == "(rx: (worker_threads: 4))"
    monkeypatch.delenv(VARIABLE)
    use_few_threads()
    assert os.environ[VARIABLE] == RUNTIMES
