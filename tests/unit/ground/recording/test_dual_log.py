"""Both files of a run are written side by side, each as far as its disk lets it."""

import errno
import json
import resource
import signal
import subprocess
import sys
import threading
from datetime import UTC, datetime
from pathlib import Path

import pytest

from ground.recording.dual_log import DualLog
from ground.recording.log_reader import frames, opened
from ground.recording.log_writer import LogFile
from tests.support.ground.recording.made import START_US, WORLD_TEXT, Said, run

NOON = datetime(2026, 3, 4, 12, 0, 5, tzinfo=UTC)


def tape_in(folder: Path) -> DualLog:
    return DualLog.new(folder, "r1", NOON, 0)


def fed(tape: DualLog, said: list[Said]) -> None:
    for number, one in enumerate(said, 1):
        tape.take(one.key, one.frame, one.time_us * 1000)
        if number % 10 == 0:
            tape.flush(number // 10, sync_every=4)


def test_both_files_have_one_name_and_the_same_frames(tmp_path: Path) -> None:
    tape, said = tape_in(tmp_path), list(run())
    tape.know("world", WORLD_TEXT)
    fed(tape, said)
    assert tape.close()
    tlog, mcap = (track.path for track in tape.tracks)
    assert (tlog.name, mcap.name) == ("20260304T120005Z-r1.tlog", "20260304T120005Z-r1.mcap")
    assert list(frames(tlog)) == list(frames(mcap))
    assert len(list(frames(mcap))) == len(said)
    log = opened(mcap)
    list(log)
    assert json.loads(log.facts["world"])["name"] == "made"


def test_a_disk_full_for_a_while_costs_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    tape, said = tape_in(tmp_path), list(run())
    fed(tape, said[:100])
    real_append = LogFile.append

    def full(log: LogFile, batch: bytes) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(LogFile, "append", full)
    fed(tape, said[100:200])
    assert tape.trouble == "No space left on device"
    monkeypatch.setattr(LogFile, "append", real_append)
    fed(tape, said[200:])
    assert tape.close()
    assert tape.trouble == ""
    for track in tape.tracks:
        log = opened(track.path)
        assert len(list(log)) == len(said)
        assert log.damage() == ""


def test_a_disk_that_takes_its_time_holds_up_no_batch(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked, done = threading.Event(), threading.Event()

    def slow(_log: LogFile) -> None:
        asked.set()
        done.wait(10.0)

    monkeypatch.setattr(LogFile, "sync", slow)
    tape, said = tape_in(tmp_path), list(run())
    fed(tape, said[:100])
    assert asked.wait(10.0)
    fed(tape, said[100:])
    tape.flush(2, sync_every=4)
    for track in tape.tracks:
        assert len(list(frames(track.path))) == len(said)
    done.set()
    assert tape.close()


def test_what_arrives_while_the_files_are_closed_is_in_none(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The first one takes time to be synchronised: the second one has no more frames."""
    tape, said = tape_in(tmp_path), list(run())
    fed(tape, said[:10])

    def arrive(_log: LogFile) -> None:
        for one in said[10:20]:
            tape.take(one.key, one.frame, one.time_us * 1000)

    monkeypatch.setattr(LogFile, "sync", arrive)
    assert tape.close()
    assert [len(list(frames(track.path))) for track in tape.tracks] == [10, 10]


def test_what_the_disk_cannot_keep_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    told = threading.Event()

    def broken(_log: LogFile) -> None:
        told.set()
        raise OSError(errno.EIO, "Input/output error")

    monkeypatch.setattr(LogFile, "sync", broken)
    tape = tape_in(tmp_path)
    tape.flush(4, sync_every=4)
    assert told.wait(10.0)
    tape.close()
    assert tape.trouble == "Input/output error"


WRITER = """
import sys
import threading
from datetime import UTC, datetime
from pathlib import Path
from ground.recording.dual_log import DualLog
from tests.support.ground.recording.made import run
tape = DualLog.new(Path(sys.argv[1]), "r1", datetime(2026, 3, 4, 12, 0, 5, tzinfo=UTC), 0)
round_number, said = 0, list(run())
while True:
    for one in said[:50]:
        tape.take(one.key, one.frame, one.time_us * 1000)
    round_number += 1
    tape.flush(round_number, sync_every=1000)
    print(min(track.recorder.written for track in tape.tracks), tape.trouble, flush=True)
"""


def writer(folder: Path) -> "subprocess.Popen[str]":
    return subprocess.Popen(
        [sys.executable, "-c", WRITER, str(folder)], stdout=subprocess.PIPE, text=True
    )


def test_killed_at_any_moment_both_files_hold_all_that_was_flushed(tmp_path: Path) -> None:
    for attempt in range(3):
        folder = tmp_path / str(attempt)
        with writer(folder) as process:
            assert process.stdout is not None
            for _ in range(2 + 7 * attempt):
                flushed = int(process.stdout.readline())
            process.send_signal(signal.SIGKILL)
        for path in sorted(folder.iterdir()):
            assert len(list(frames(path))) >= flushed > 0


def test_without_room_what_is_there_is_whole(tmp_path: Path) -> None:
    """A file may grow to 40 kB and no more: what the kernel takes of a batch is given back."""
    with writer(tmp_path) as process:
        assert process.stdout is not None
        process.stdout.readline()
        resource.prlimit(process.pid, resource.RLIMIT_FSIZE, (40_000, 40_000))
        said = next(line for line in process.stdout if "File too large" in line)
        process.kill()
    assert int(said.split()[0]) > 0
    for path in tmp_path.iterdir():
        log = opened(path)
        assert len(list(log)) > 0
        assert log.lost_bytes == 0
        assert path.stat().st_size <= 40_000


def test_the_stamps_are_those_of_the_frames(tmp_path: Path) -> None:
    tape = tape_in(tmp_path)
    fed(tape, list(run(2)))
    tape.close()
    for track in tape.tracks:
        assert next(frames(track.path)).time_ns == START_US * 1000
