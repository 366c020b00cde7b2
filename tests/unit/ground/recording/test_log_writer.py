"""The log writer keeps whole records on a failing disk, and counts dropped frames."""

import errno
import io
import os
import signal
import subprocess
import sys
import threading
from datetime import UTC, datetime
from pathlib import Path

import pytest

from ground.recording.log_reader import TlogReader, read
from ground.recording.log_writer import FRAME_COST, LogFile, LogWriter, new_log
from protocol.wire.codec import Encoder
from protocol.wire.messages import Statustext

OFFSET_NS = 1_790_000_000_000_000_000
NOON = datetime(2026, 3, 4, 12, 0, 5, tzinfo=UTC)


class Disk:
    """A sink that simulates a full or failing disk."""

    def __init__(self) -> None:
        self.data = b""
        self.full = self.fails = False
        self.closed = False

    def append(self, batch: bytes) -> None:
        if self.full:
            raise OSError(errno.ENOSPC, "No space left on device")
        self.data += batch

    def sync(self) -> None:
        if self.full or self.fails:
            raise OSError(errno.EIO, "Input/output error")

    def close(self) -> None:
        self.closed = True


def frame(text: str) -> bytes:
    return Encoder(1, 1).encode(Statustext(severity=6, text=text))


def texts(data: bytes) -> int:
    return len(list(TlogReader(io.BytesIO(data))))


def test_frames_are_stamped_in_utc_and_ordered() -> None:
    disk = Disk()
    recorder = LogWriter(disk, OFFSET_NS)
    for n in range(5):
        recorder.take("sidestep/r1/tlm/text", frame(f"n{n}"), n * 1_000_000)
    assert recorder.flush()
    records = list(TlogReader(io.BytesIO(disk.data)))
    assert [record.time_us for record in records] == [
        OFFSET_NS // 1000 + n * 1000 for n in range(5)
    ]
    assert recorder.written == 5
    assert recorder.close()
    assert disk.closed


def test_cached_sample_is_logged_when_it_arrives() -> None:
    """Log times never decrease; an event before the start gets the start time."""
    disk = Disk()
    recorder = LogWriter(disk, OFFSET_NS, began_us=OFFSET_NS // 1000)
    for told_ms in (-60_000, 10, 20, 12, 30):
        recorder.take("k", frame(f"told at {told_ms}"), told_ms * 1_000_000)
    recorder.flush()
    stamps_us = [record.time_us - OFFSET_NS // 1000 for record in TlogReader(io.BytesIO(disk.data))]
    assert stamps_us == [0, 10_000, 20_000, 20_000, 30_000]


def test_malformed_frame_is_counted_and_not_written() -> None:
    disk = Disk()
    recorder = LogWriter(disk, OFFSET_NS)
    for junk in (b"", b"\xfd", b"hello", frame("cut short")[:-1]):
        recorder.take("k", junk, 0)
    recorder.take("k", frame("good"), 0)
    assert recorder.flush()
    assert recorder.rejected == 4
    assert texts(disk.data) == 1


def test_full_disk_is_reported_and_recovers() -> None:
    disk = Disk()
    recorder = LogWriter(disk, OFFSET_NS)
    disk.full = True
    recorder.take("k", frame("while full"), 0)
    assert not recorder.flush()
    assert recorder.error == "No space left on device"
    recorder.sync()
    assert recorder.error == "Input/output error"
    disk.full = False
    recorder.take("k", frame("after"), 1)
    assert recorder.flush()
    assert recorder.error == ""
    assert texts(disk.data) == 2
    assert recorder.close()


def test_full_disk_bounds_memory_and_counts_drops() -> None:
    disk = Disk()
    recorder = LogWriter(disk, OFFSET_NS, max_waiting_bytes=200)
    disk.full = True
    for n in range(1000):
        recorder.take("k", frame(f"{n}"), n)
        recorder.flush()
    assert recorder.dropped > 900
    assert not recorder.close()
    assert recorder.dropped == 1000
    assert disk.closed


def test_memory_is_bounded_while_the_disk_hangs() -> None:
    """Frames arrive while the writing thread hangs."""
    disk = Disk()
    recorder = LogWriter(disk, OFFSET_NS, max_waiting_bytes=100 * (FRAME_COST + 40))
    one = frame("while it hangs")
    for n in range(10_000):
        recorder.take("k", one, n)
    assert len(recorder._arrived) < 110
    assert recorder.dropped == 10_000 - len(recorder._arrived)
    kept = len(recorder._arrived)
    assert recorder.flush()
    assert recorder.drop_reason == "the disk took too long"
    recorder.take("k", one, 10_000)
    assert not recorder.close(), "losses are reported at the end"
    assert texts(disk.data) == recorder.written == kept + 1
    assert recorder.dropped == 10_000 - kept


def test_long_keys_are_rejected_and_counted() -> None:
    """Reject keys of 60,000 characters: the key is stored with each frame."""
    disk = Disk()
    recorder = LogWriter(disk, OFFSET_NS, max_waiting_bytes=1_000_000)
    one, key = frame("x"), "k" * 60_000
    for n in range(1000):
        recorder.take(key, one, n)
    assert len(recorder._arrived) < 20
    recorder.flush()
    assert recorder.rejected + recorder.dropped == 1000
    assert disk.data == b""


def test_frames_of_many_threads_are_counted_once() -> None:
    disk = Disk()
    recorder = LogWriter(disk, OFFSET_NS, max_waiting_bytes=50 * FRAME_COST)
    one = frame("x")

    def send() -> None:
        for _ in range(500):
            recorder.take("k", one, 0)

    threads = [threading.Thread(target=send) for _ in range(4)]
    for thread in threads:
        thread.start()
    while any(thread.is_alive() for thread in threads):
        recorder.flush()
    recorder.close()
    assert recorder.written + recorder.dropped == 2000


def test_failed_flush_counts_its_frames_as_lost() -> None:
    """Count frames as lost: the kernel drops such pages, then reports success."""
    disk = Disk()
    recorder = LogWriter(disk, OFFSET_NS)

    def written(count: int) -> None:
        for n in range(count):
            recorder.take("k", frame(f"{n}"), n)
        assert recorder.flush()

    written(3)
    recorder.sync()
    assert recorder.dropped == 0
    written(5)
    disk.fails = True
    recorder.sync()
    assert recorder.dropped == 5
    disk.fails = False
    written(2)
    recorder.sync()
    assert (recorder.dropped, recorder.error) == (5, "")
    assert recorder.drop_reason == "Input/output error"
    assert not recorder.close()
    assert recorder.dropped == 5


def test_close_flushes_the_last_frames() -> None:
    disk = Disk()
    recorder = LogWriter(disk, OFFSET_NS)
    recorder.take("k", frame("last"), 0)
    disk.fails = True
    assert not recorder.close()
    assert (recorder.dropped, disk.closed) == (1, True)


def test_partial_batch_is_removed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    log = LogFile(tmp_path / "a.tlog")
    recorder = LogWriter(log, OFFSET_NS)
    recorder.take("k", frame("before"), 0)
    recorder.flush()
    real_write = os.write

    def nearly_full(fd: int, data: bytes) -> int:
        if len(data) <= 10:
            raise OSError(errno.ENOSPC, "No space left on device")
        return real_write(fd, data[: len(data) - 10])

    recorder.take("k", frame("during"), 1)
    with monkeypatch.context() as full:
        full.setattr(os, "write", nearly_full)
        assert not recorder.flush()
    assert len(list(read(log.path))) == 1
    assert recorder.close()
    assert len(list(read(log.path))) == 2


def test_new_log_never_overwrites_a_file(tmp_path: Path) -> None:
    first = new_log(tmp_path / "deep" / "down", "r1", NOON)
    second = new_log(tmp_path / "deep" / "down", "r1", NOON)
    assert first.path.name == "20260304T120005Z-r1.tlog"
    assert second.path.name == "20260304T120005Z-r1.1.tlog"
    first.close()
    second.close()


WRITER = """
import sys
from pathlib import Path
from ground.recording.log_writer import LogFile, LogWriter
from protocol.wire.codec import Encoder
from protocol.wire.messages import Statustext
recorder = LogWriter(LogFile(Path(sys.argv[1])), 1_790_000_000_000_000_000)
encoder, n = Encoder(1, 1), 0
while True:
    for _ in range(50):
        recorder.take("k", encoder.encode(Statustext(severity=6, text=f"frame {n}")), n * 1000)
        n += 1
    recorder.flush()
    print(recorder.written, flush=True)
"""


def test_killed_writer_keeps_flushed_frames(tmp_path: Path) -> None:
    for attempt in range(3):
        path = tmp_path / f"{attempt}.tlog"
        with subprocess.Popen(
            [sys.executable, "-c", WRITER, str(path)], stdout=subprocess.PIPE, text=True
        ) as writer:
            assert writer.stdout is not None
            for _ in range(1 + 7 * attempt):
                flushed = int(writer.stdout.readline())
            writer.send_signal(signal.SIGKILL)
        assert len(list(read(path))) >= flushed
