"""Ctrl-C and SIGTERM at whatever moment: all end, and the log is whole.

On a machine that does nothing else they end within two seconds, which tests in real time show.
"""

import fcntl
import os
import pty
import signal
import subprocess
import sys
import termios
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import pytest

from ground.launch.child_command import command
from tests.support.stack.process_table import alive, children_of, frames_in
from tests.support.stack.processes import Crew, Running, Witness, departs
from tests.support.until import PATIENCE_S, until

pytestmark = pytest.mark.stack

AT_ONCE_S = 2.0
ENDED_BY = {"watch", "ground", "goto"}  # they have not done what they were asked to
OWN_TERMINAL = f"""
import fcntl, os, sys
fcntl.ioctl(0, {termios.TIOCSCTTY}, 0)
os.execv(sys.argv[1], sys.argv[1:])
"""


@contextmanager
def everybody(folder: Path) -> Iterator[tuple[dict[str, Running], Witness]]:
    """Start every kind of process and a driving robot; yield them in the order of their end."""
    with Crew() as crew, Crew(router=True) as other:
        plant, robot = crew.plant(waits=False), crew.robot()
        with Witness(crew.endpoint) as witness:
            witness.ready()
            found = {
                "watch": crew.dialling("watch"),
                "ground": crew.dialling("ground"),
                "record": crew.dialling("record", str(folder)),
                "goto": departs(crew, witness, "goto", "5.4", "2"),
            }
            until(lambda: written(folder) > 2000, what="a log")
            found["watch"].says("r1")
            found["ground"].says("r1")
            yield {**found, "plant": plant, "robot": robot, "router": other.router}, witness


def written(folder: Path) -> int:
    return sum(log.stat().st_size for log in folder.glob("*.tlog"))


def ends_well(name: str, running: Running, number: signal.Signals, within_s: float) -> None:
    assert running.ends(within_s) == (128 + number if name in ENDED_BY else 0), running.said
    assert "Traceback" not in running.said


@pytest.mark.parametrize(
    ("number", "within_s"),
    [
        pytest.param(signal.SIGINT, AT_ONCE_S, marks=pytest.mark.realtime),
        (signal.SIGTERM, PATIENCE_S),
    ],
)
def test_each_process_ends_in_time(tmp_path: Path, number: signal.Signals, within_s: float) -> None:
    with everybody(tmp_path) as (processes, _):
        for name, running in processes.items():
            running.send(number)
            ends_well(name, running, number, within_s)
    assert frames_in(tmp_path) > 20


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_signals_sent_while_a_verb_ends_change_nothing(number: signal.Signals) -> None:
    with Crew() as crew:
        crew.plant(waits=False)
        crew.robot()
        watching = crew.dialling("watch")
        watching.says("r1")
        for _ in range(2000):
            watching.send(number)
            with suppress(subprocess.TimeoutExpired):
                watching.process.wait(0.001)
        assert watching.ends() == 128 + number
        assert watching.said.count("sidestep watch: interrupted") == 1
        assert "Traceback" not in watching.said


@pytest.mark.parametrize(
    ("number", "within_s"),
    [
        (signal.SIGKILL, PATIENCE_S),
        pytest.param(signal.SIGSTOP, AT_ONCE_S, marks=pytest.mark.realtime),
    ],
)
def test_they_end_although_their_hub_is_gone_or_hangs(
    tmp_path: Path, number: signal.Signals, within_s: float
) -> None:
    with everybody(tmp_path) as (processes, witness):
        processes.pop("robot").send(number)
        until(witness.bus.lost, what="the link to be given up")
        for running in processes.values():
            running.send(signal.SIGINT)
        for name, running in processes.items():
            ends_well(name, running, signal.SIGINT, within_s)
    assert frames_in(tmp_path) > 20


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("role", ["plant", "robot"])
def test_process_that_still_connects_ends_too(role: str, number: signal.Signals) -> None:
    with Crew() as crew:
        dialling = crew.dialling(role)
        until(lambda: opening(dialling), what="dialling")
        dialling.send(number)
        assert dialling.ends() in (130, -signal.SIGTERM)
        assert "Traceback" not in dialling.said


def opening(running: Running) -> bool:
    """Zenoh's threads are there, so it is being opened."""
    return len(list(Path(f"/proc/{running.process.pid}/task").iterdir())) > 2


@pytest.mark.parametrize("children", [1, 2, 3])
def test_up_ends_at_any_moment_of_its_start(tmp_path: Path, children: int) -> None:
    with Crew() as crew:
        up = crew.start("up", "--json", "--record", str(tmp_path))
        until(lambda: len(children_of(up.process.pid)) >= children, what="children")
        started = children_of(up.process.pid)
        up.send(signal.SIGINT)
        assert up.ends() == 130
        assert not [pid for pid in started if alive(pid)]
        assert "Traceback" not in up.said


def test_ctrl_c_in_a_terminal_ends_up_and_all_it_started(tmp_path: Path) -> None:
    """The terminal sends SIGINT to the whole process group."""
    ours, theirs = pty.openpty()
    words = command(["up", "--headless", "--record", str(tmp_path)], os.getpid())
    with Crew() as crew, os.fdopen(ours, "wb", buffering=0) as keyboard:
        up = crew.execute(sys.executable, "-c", OWN_TERMINAL, *words, terminal=theirs)
        os.close(theirs)
        fcntl.fcntl(ours, fcntl.F_SETFL, os.O_NONBLOCK)
        screen = bytearray()
        until(lambda: b" m/s" in read(ours, screen), what="the live line")
        until(lambda: written(tmp_path) > 2000, what="a log")
        started = children_of(up.process.pid)
        keyboard.write(b"\x03")
        assert up.ends() == 130
        assert b"interrupted" in read(ours, screen)
        assert b"Traceback" not in screen
    assert len(started) == 3
    assert not [pid for pid in started if alive(pid)]
    assert frames_in(tmp_path) > 20


def read(terminal: int, screen: bytearray) -> bytearray:
    with suppress(BlockingIOError, OSError):  # nothing new, or the other end is closed
        screen += os.read(terminal, 1 << 16)
    return screen
