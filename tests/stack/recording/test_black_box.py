"""The recorder, killed or out of room: what it has is whole, and the robot does not mind."""

import random
import resource
import signal
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import pairwise
from pathlib import Path

import pytest

from ground.recording.log_reader import open_log
from protocol.wire.codec import decode
from protocol.wire.enums import GoalState
from tests.support.stack.processes import Crew, Running, Witness, departs
from tests.support.until import until

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
