"""A recorder that is killed, or whose disk is full for a while, as a process of its own."""

import os
import resource
import signal
import threading
import time
from bisect import bisect_left
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from random import Random
from typing import Final

import pytest

from ground.recording.catalogue import PARTS, recordings_in, size_in, size_of
from ground.recording.log_reader import number_of, open_log
from protocol.bus.bus import open_bus
from protocol.bus.network import Network
from protocol.topics import WHEELS, Role
from protocol.wire.codec import decode
from protocol.wire.messages import WheelTicks
from tests.support.stack.processes import Crew, Running
from tests.support.until import until

pytestmark = pytest.mark.stack

KILLS: Final = 6
STARTS_S: Final = 60.0
EVERY_S: Final = 0.02
LOST_AT_MOST_S: Final = 1.0


class TopicEncoder:
    """Publishes a number, by default fifty times a second, and stores the time of each."""

    def __init__(self, network: Network, every_s: float = EVERY_S) -> None:
        self._every_s = every_s
        self.said_s: list[float] = []
        self.bus = open_bus(network, Role.PLANT, "r1")
        self._wheels = self.bus.publisher(WHEELS)
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._speak, daemon=True)

    def _speak(self) -> None:
        while not self._stop.wait(self._every_s):
            number = len(self.said_s)
            self._wheels.put(
                WheelTicks(time_ns=number, seq=number, left=0, right=0, bumper=0, expired=0)
            )
            self.said_s.append(time.monotonic())

    @contextmanager
    def speaking(self) -> Iterator["TopicEncoder"]:
        with self.bus:
            self._thread.start()
            try:
                yield self
            finally:
                self._stop.set()
                self._thread.join()


def numbers_in(path: Path) -> list[int]:
    messages = [decode(one.frame).message for one in open_log(path)]
    return [one.seq for one in messages if isinstance(one, WheelTicks)]


def logs_in(folder: Path) -> tuple[Path, Path]:
    (tlog,) = folder.glob("*.tlog")
    return tlog, tlog.with_suffix(".mcap")


@contextmanager
def stage(every_s: float = EVERY_S) -> Iterator[tuple[Crew, TopicEncoder]]:
    """Start only a publisher, to which recorders connect."""
    with Crew() as crew:
        network = Network(mode="peer", listen=(crew.endpoint,))
        with TopicEncoder(network, every_s).speaking() as speaker:
            yield crew, speaker


def recorder(crew: Crew, folder: Path, *words: str) -> Running:
    return crew.dialling("record", str(folder), "--id", "r1", *words)


@pytest.mark.realtime
def test_killed_with_its_group_at_any_moment_a_recorder_loses_the_last_second_at_most(
    tmp_path: Path,
) -> None:
    random, lost_s = Random(1), []
    with stage() as (crew, speaker):
        folders = [tmp_path / f"{number}" for number in range(KILLS)]
        running = [recorder(crew, folder) for folder in folders]
        until(lambda: all(map(recorded, folders)), STARTS_S, "both files of each")
        killed_s = []
        for one in running:
            threading.Event().wait(random.uniform(0.0, 0.2))
            killed_s.append(time.monotonic())
            os.killpg(one.process.pid, signal.SIGKILL)
        for folder, one, at_s in zip(folders, running, killed_s, strict=True):
            one.ends()
            lost_s += [lost(path, speaker, at_s) for path in logs_in(folder)]
    assert len(lost_s) == 2 * KILLS
    assert max(lost_s) <= LOST_AT_MOST_S, sorted(lost_s)


def recorded(folder: Path) -> bool:
    return sum(path.stat().st_size > 4000 for path in folder.glob("*.*")) == 2


def lost(path: Path, speaker: TopicEncoder, killed_s: float) -> float:
    """Return the seconds from the first missing frame to the kill; no later frame exists."""
    numbers = numbers_in(path)
    assert numbers == list(range(numbers[0], numbers[-1] + 1))
    said = bisect_left(speaker.said_s, killed_s)
    missing = speaker.said_s[numbers[-1] + 1 : said]
    return killed_s - missing[0] if missing else 0.0


def test_a_disk_that_was_full_for_a_while_costs_nothing(tmp_path: Path) -> None:
    with stage() as (crew, speaker):
        running = recorder(crew, tmp_path)
        until(lambda: recorded(tmp_path), STARTS_S, "both files")
        full = max(path.stat().st_size for path in logs_in(tmp_path)) + 2000
        limits = (full, resource.RLIM_INFINITY)
        resource.prlimit(running.process.pid, resource.RLIMIT_FSIZE, limits)
        running.says("RECORDING FAILS: File too large; the robot drives on")
        anywhere = (resource.RLIM_INFINITY, resource.RLIM_INFINITY)
        resource.prlimit(running.process.pid, resource.RLIMIT_FSIZE, anywhere)
        running.says("RECORDING resumed")
        said = len(speaker.said_s)
        until(lambda: len(speaker.said_s) > said + 10)
        running.send(signal.SIGINT)
        assert running.ends() == 0, running.said
    for path in logs_in(tmp_path):
        numbers = numbers_in(path)
        assert numbers == list(range(numbers[0], numbers[-1] + 1))
        assert numbers[-1] > said
        log = open_log(path)
        assert len(list(log)) == len(numbers)
        assert log.damage() == ""


def test_long_run_keeps_within_its_limit_and_loses_no_frame_between_its_parts(
    tmp_path: Path,
) -> None:
    keep, sizes = "0.4MB", []

    def many() -> bool:
        sizes.append(sum(map(size_of, tmp_path.iterdir())))
        return any(number_of(path) > PARTS + 3 for path in recordings_in(tmp_path))

    with stage(every_s=0.001) as (crew, speaker):
        running = recorder(crew, tmp_path, "--keep", keep)
        until(many, 2 * STARTS_S, "a recording that has lost its oldest parts")
        said = len(speaker.said_s)
        until(lambda: len(speaker.said_s) > said + 10)
        running.send(signal.SIGINT)
        assert running.ends() == 0, running.said
    (path,) = recordings_in(tmp_path)
    for suffix in (".mcap", ".tlog"):
        log = open_log(path.with_suffix(suffix))
        messages = [decode(one.frame).message for one in log]
        numbers = [one.seq for one in messages if isinstance(one, WheelTicks)]
        assert numbers == list(range(numbers[0], numbers[-1] + 1))
        assert numbers[0] > 0
        assert numbers[-1] > said
        assert log.damage() == ""
    slack = size_in(keep) / PARTS  # a part is as large as what arrives in half a second
    assert max(sizes) <= size_in(keep) + slack, max(sizes)
