"""Both files of a run are written in parallel, each as far as its disk allows."""

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

from ground.recording.log_reader import open_log
from ground.recording.log_writer import DualLog, LogFile
from tests.support.ground.recording.made import START_US, WORLD_TEXT, PublishedFrame, run
from tests.support.until import PATIENCE_S

NOON = datetime(2026, 3, 4, 12, 0, 5, tzinfo=UTC)


def dual_log_in(folder: Path) -> DualLog:
    return DualLog.new(folder, "r1", NOON, 0)


def fed(dual_log: DualLog, frames_sent: list[PublishedFrame]) -> None:
    for number, one in enumerate(frames_sent, 1):
        dual_log.take(one.key, one.frame, one.time_us * 1000)
        if number % 10 == 0:
            dual_log.flush(number // 10, sync_every=4)


def test_both_files_hold_the_same_frames(tmp_path: Path) -> None:
    dual_log, frames_sent = dual_log_in(tmp_path), list(run())
    dual_log.add_fact("world", WORLD_TEXT)
    fed(dual_log, frames_sent)
    assert dual_log.close()
    tlog, mcap = (track.path for track in dual_log.tracks)
    assert (tlog.name, mcap.name) == ("20260304T120005Z-r1.tlog", "20260304T120005Z-r1.mcap")
    assert list(open_log(tlog)) == list(open_log(mcap))
    assert len(list(open_log(mcap))) == len(frames_sent)
    log = open_log(mcap)
    list(log)
    assert json.loads(log.facts["world"])["name"] == "made"


def test_temporarily_full_disk_loses_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    dual_log, frames_sent = dual_log_in(tmp_path), list(run())
    fed(dual_log, frames_sent[:100])
    real_append = LogFile.append

    def full(log: LogFile, batch: bytes) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(LogFile, "append", full)
    fed(dual_log, frames_sent[100:200])
    assert dual_log.error == "No space left on device"
    monkeypatch.setattr(LogFile, "append", real_append)
    fed(dual_log, frames_sent[200:])
    assert dual_log.close()
    assert dual_log.error == ""
    for track in dual_log.tracks:
        log = open_log(track.path)
        assert len(list(log)) == len(frames_sent)
        assert log.damage() == ""


def test_slow_disk_delays_no_batch(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    requested, done = threading.Event(), threading.Event()

    def slow(_log: LogFile) -> None:
        requested.set()
        done.wait(PATIENCE_S)

    monkeypatch.setattr(LogFile, "sync", slow)
    dual_log, frames_sent = dual_log_in(tmp_path), list(run())
    fed(dual_log, frames_sent[:100])
    assert requested.wait(PATIENCE_S)
    fed(dual_log, frames_sent[100:])
    dual_log.flush(2, sync_every=4)
    for track in dual_log.tracks:
        assert len(list(open_log(track.path))) == len(frames_sent)
    done.set()
    assert dual_log.close()


def test_frames_during_close_are_in_no_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Frames that arrive while the first file is flushed are not in the second one either."""
    dual_log, frames_sent = dual_log_in(tmp_path), list(run())
    fed(dual_log, frames_sent[:10])

    def arrive(_log: LogFile) -> None:
        for one in frames_sent[10:20]:
            dual_log.take(one.key, one.frame, one.time_us * 1000)

    monkeypatch.setattr(LogFile, "sync", arrive)
    assert dual_log.close()
    assert [len(list(open_log(track.path))) for track in dual_log.tracks] == [10, 10]


def test_failed_flush_is_reported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    reported = threading.Event()

    def broken(_log: LogFile) -> None:
        reported.set()
        raise OSError(errno.EIO, "Input/output error")

    monkeypatch.setattr(LogFile, "sync", broken)
    dual_log = dual_log_in(tmp_path)
    dual_log.flush(4, sync_every=4)
    assert reported.wait(PATIENCE_S)
    dual_log.close()
    assert dual_log.error == "Input/output error"


WRITER = """
import sys
import threading
from datetime import UTC, datetime
from pathlib import Path
from ground.recording.log_writer import DualLog
from tests.support.ground.recording.made import run
dual_log = DualLog.new(Path(sys.argv[1]), "r1", datetime(2026, 3, 4, 12, 0, 5, tzinfo=UTC), 0)
round_number, frames_sent = 0, list(run())
while True:
    for one in frames_sent[:50]:
        dual_log.take(one.key, one.frame, one.time_us * 1000)
    round_number += 1
    dual_log.flush(round_number, sync_every=1000)
    print(min(track.writer.written for track in dual_log.tracks), dual_log.error, flush=True)
"""


def writer(folder: Path) -> "subprocess.Popen[str]":
    return subprocess.Popen(
        [sys.executable, "-c", WRITER, str(folder)], stdout=subprocess.PIPE, text=True
    )


def test_killed_writer_keeps_flushed_frames_in_both_files(tmp_path: Path) -> None:
    for attempt in range(3):
        folder = tmp_path / str(attempt)
        with writer(folder) as process:
            assert process.stdout is not None
            for _ in range(2 + 7 * attempt):
                flushed = int(process.stdout.readline())
            process.send_signal(signal.SIGKILL)
        for path in sorted(folder.iterdir()):
            assert len(list(open_log(path))) >= flushed > 0


def test_full_disk_leaves_whole_records(tmp_path: Path) -> None:
    """Remove a partially written batch; the file is limited to 40 kB."""
    with writer(tmp_path) as process:
        assert process.stdout is not None
        process.stdout.readline()
        resource.prlimit(process.pid, resource.RLIMIT_FSIZE, (40_000, 40_000))
        frames_sent = next(line for line in process.stdout if "File too large" in line)
        process.kill()
    assert int(frames_sent.split()[0]) > 0
    for path in tmp_path.iterdir():
        log = open_log(path)
        assert len(list(log)) > 0
        assert log.lost_bytes == 0
        assert path.stat().st_size <= 40_000


def test_stamps_are_those_of_the_frames(tmp_path: Path) -> None:
    dual_log = dual_log_in(tmp_path)
    fed(dual_log, list(run(2)))
    dual_log.close()
    for track in dual_log.tracks:
        assert next(iter(open_log(track.path))).time_ns == START_US * 1000
