"""Recorders that are killed or out of room, and pymavlink's tool on their files."""

import os
import random
import resource
import shutil
import signal
import subprocess
import sys
import threading
import time
from bisect import bisect_left
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import pairwise
from pathlib import Path
from random import Random
from typing import Final

import pymavlink
import pytest

from checks.harness.crew import Crew, Witness, departs
from checks.harness.messages import make
from checks.harness.processes import Running
from checks.harness.until import until
from ground.recording.catalogue import PARTS, recordings_in, size_in, size_of
from ground.recording.log_reader import number_of, open_log, record_bytes
from protocol.bus.bus import open_bus
from protocol.bus.network import Network
from protocol.topics import WHEELS, Role
from protocol.wire.codec import Encoder, decode
from protocol.wire.enums import GoalState
from protocol.wire.messages import SonarScan, Statustext, WheelTicks

pytestmark = pytest.mark.stack

NS_PER_S = 1_000_000_000
LITTLE_ROOM_BYTES = 60_000
TORN_CHUNK = 100_000
MOMENTS = random.Random(3)


@contextmanager
def recorded(folder: Path) -> Iterator[tuple[Crew, Witness, Running]]:
    """Start a robot that drives, and its recorder."""
    with Crew(lockstep=True) as crew:
        crew.plant(waits=False)
        crew.robot()
        with Witness(crew.endpoint) as witness:
            witness.ready()
            recorder = crew.dialling("record", str(folder))
            recorder.says("recording")
            yield crew, witness, recorder


def stamps_in(log: Path) -> tuple[list[int], int]:
    """Plant's time of each status in the log, and how many bytes of it are of no use."""
    recording = open_log(log)
    messages = [decode(one.frame).message for one in recording]
    kinds = Counter(type(message).__name__ for message in messages)
    assert kinds["SonarScan"] > 5
    stamps = [m.time_ns for m in messages if type(m).__name__ == "NavigatorStatus"]  # type: ignore[attr-defined]
    return stamps, recording.lost_bytes


def most_missing(stamps: list[int], witness: Witness) -> int:
    """Return how many statuses in a row the witness has received and the log lacks, at most."""
    seen = [status.time_ns for status, _ in tuple(witness.statuses)]
    return max(
        sum(earlier < stamp < later for stamp in seen) for earlier, later in pairwise(stamps)
    )


def test_killed_at_any_moment_its_log_has_no_gap(tmp_path: Path) -> None:
    with recorded(tmp_path / "0") as (crew, witness, recorder):
        for number in range(1, 4):
            after_ns = witness.status.time_ns + NS_PER_S * 3 // 4 + MOMENTS.randrange(NS_PER_S // 2)
            until(lambda after_ns=after_ns: witness.status.time_ns > after_ns)  # type: ignore[misc]
            recorder.send(signal.SIGKILL)
            recorder.ends()
            tlog, mcap = sorted((tmp_path / str(number - 1)).iterdir(), reverse=True)
            for log, torn in ((tlog, 300), (mcap, TORN_CHUNK)):
                stamps, lost_bytes = stamps_in(log)
                assert lost_bytes < torn, "no more than what was being written"
                assert most_missing(stamps, witness) <= 1, "nothing is missing in between"
            recorder = crew.dialling("record", str(tmp_path / str(number)))
            recorder.says("recording")


def test_full_disk_is_reported_and_the_drive_continues(tmp_path: Path) -> None:
    with recorded(tmp_path) as (crew, witness, recorder):
        room = (LITTLE_ROOM_BYTES, LITTLE_ROOM_BYTES)
        resource.prlimit(recorder.process.pid, resource.RLIMIT_FSIZE, room)
        goto = departs(crew, witness, "goto", "5.4", "2")
        recorder.says("RECORDING FAILS: File too large; the robot drives on")
        goto.send(signal.SIGINT)
        goto.ends()
        code, said = crew.run("goto", "1.6", "2")
        assert code == 0, said
        until(lambda: witness.status.goal == GoalState.REACHED, what="REACHED")
        recorder.send(signal.SIGINT)
        assert recorder.ends() == 1
        assert "LOST" in recorder.said
    tlog, mcap = sorted(tmp_path.iterdir(), reverse=True)
    for log in (tlog, mcap):
        stamps, lost_bytes = stamps_in(log)
        assert lost_bytes == 0, "what is there is whole"
        assert len(stamps) > 10


def test_when_there_is_room_again_it_goes_on_and_nothing_is_lost(tmp_path: Path) -> None:
    with recorded(tmp_path) as (_, witness, recorder):
        pid, unlimited = recorder.process.pid, resource.RLIM_INFINITY
        resource.prlimit(pid, resource.RLIMIT_FSIZE, (LITTLE_ROOM_BYTES, unlimited))
        recorder.says("RECORDING FAILS: File too large; the robot drives on")
        resource.prlimit(pid, resource.RLIMIT_FSIZE, (unlimited, unlimited))
        recorder.says("RECORDING resumed: the log can be written again")
        after_ns = witness.status.time_ns
        until(lambda: witness.status.time_ns > after_ns + NS_PER_S)
        recorder.send(signal.SIGINT)
        assert recorder.ends() == 0, recorder.said
    for log in tmp_path.iterdir():
        stamps, lost_bytes = stamps_in(log)
        assert lost_bytes == 0
        assert stamps[-1] > after_ns
        assert most_missing(stamps, witness) <= 1


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
        until(
            lambda: all(map(recorded_until_killed, folders)),
            within_s=STARTS_S,
            what="both files of each",
        )
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


def recorded_until_killed(folder: Path) -> bool:
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
        until(lambda: recorded_until_killed(tmp_path), within_s=STARTS_S, what="both files")
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
        until(many, within_s=2 * STARTS_S, what="a recording that has lost its oldest parts")
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


ROOT = Path(__file__).parents[2]
INSTALLED = Path(pymavlink.__file__).parent
START_US = 1_763_700_000_000_000


@pytest.fixture
def borrowed(tmp_path: Path) -> Path:
    """Copy pymavlink to a writable folder and add our dialect."""
    package = tmp_path / "pymavlink"
    package.mkdir()
    for path in (*INSTALLED.glob("*.py"), *INSTALLED.glob("*.so")):
        shutil.copy(path, package)
    shutil.copytree(INSTALLED / "generator", package / "generator")
    dialects = package / "dialects" / "v20"
    dialects.mkdir(parents=True)
    shutil.copy(INSTALLED / "dialects" / "__init__.py", dialects.parent)
    for name in ("__init__.py", "all.py", "common.xml", "standard.xml", "minimal.xml"):
        shutil.copy(INSTALLED / "dialects" / "v20" / name, dialects)
    shutil.copy(ROOT / "protocol" / "dialect" / "sidestep.xml", dialects)
    return tmp_path


def test_every_record_is_read_with_its_time_and_its_fields(borrowed: Path) -> None:
    encoder = Encoder(1, 1)
    ranges_mm = (100, 200, 300, 400, 500, 600, 700, 800)
    messages = [
        WheelTicks(time_ns=50_000_000, seq=1, left=-7, right=7, bumper=0, expired=0),
        make(SonarScan, time_ns=50_000_000, seq=1, range_mm=ranges_mm, echo=255),
        Statustext(severity=6, text="ready", id=0, chunk_seq=0),
    ]
    log = borrowed / "run.tlog"
    records = (record_bytes(START_US, encoder.encode(message)) for message in messages)
    log.write_bytes(b"".join(records))
    tool = Path(sys.executable).with_name("mavlogdump.py")
    run = subprocess.run(
        [sys.executable, str(tool), "--dialect", "sidestep", str(log)],
        env={"PYTHONPATH": str(borrowed), "MAVLINK20": "1", "TZ": "UTC"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert run.returncode == 0, run.stderr
    lines = run.stdout.splitlines()
    assert len(lines) == len(messages)
    assert "WHEEL_TICKS {time_ns : 50000000, seq : 1, left : -7, right : 7" in lines[0]
    assert lines[0].startswith("2025-11-21 04:40:00.00")
    assert f"range_mm : {list(ranges_mm)}" in lines[1]
    assert "text : ready" in lines[2]
