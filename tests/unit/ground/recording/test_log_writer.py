"""Recordings as they are written: whole records on a failing disk, both formats, and metadata."""

import errno
import gc
import io
import json
import os
import resource
import signal
import subprocess
import sys
import threading
import tracemalloc
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from mcap.reader import make_reader

from checks.harness.until import PATIENCE_S
from ground.recording.log_reader import TlogReader, open_log, read
from ground.recording.log_writer import FRAME_COST, DualLog, LogFile, LogWriter, new_log
from ground.recording.mcap_file import McapFormat
from ground.recording.metadata import MetadataReader
from protocol.topics import ENCODING, PARAMETERS, WORLD, Service
from protocol.wire.codec import Encoder
from protocol.wire.message import Message
from protocol.wire.messages import AvoidanceDecision, Statustext
from runtime.errors import NoAnswerError
from runtime.units import NS_PER_S as S
from tests.support.ground.made_recordings import (
    START_US,
    WORLD_TEXT,
    PublishedFrame,
    decision,
    mcap,
    problem,
    run,
)

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
    real_write = os.pwrite

    def nearly_full(fd: int, data: bytes, place: int) -> int:
        if len(data) <= 10:
            raise OSError(errno.ENOSPC, "No space left on device")
        return real_write(fd, data[: len(data) - 10], place)

    recorder.take("k", frame("during"), 1)
    with monkeypatch.context() as full:
        full.setattr(os, "pwrite", nearly_full)
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


FOXGLOVE: dict[str, set[str]] = {
    "foxglove.PoseInFrame": {"timestamp", "frame_id", "pose"},
    "foxglove.PosesInFrame": {"timestamp", "frame_id", "poses"},
    "foxglove.SceneUpdate": {"deletions", "entities"},
    "foxglove.FrameTransform": {
        *("timestamp", "parent_frame_id", "child_frame_id"),
        *("translation", "rotation"),
    },
    "foxglove.Log": {"timestamp", "level", "message", "name", "file", "line"},
    "foxglove.PointCloud": {
        *("timestamp", "frame_id", "pose"),
        *("point_stride", "fields", "data"),
    },
}
"""Fields that the viewers expect: https://docs.foxglove.dev/docs/sdk/schemas."""
ENTITY = {
    *("timestamp", "frame_id", "id", "lifetime", "frame_locked", "metadata"),
    *("arrows", "cubes", "spheres", "cylinders", "lines", "triangles", "texts", "models"),
}


class Found:
    """A file as the MCAP library reads it, checksums included."""

    def __init__(self, path: Path) -> None:
        reader = make_reader(io.BytesIO(path.read_bytes()), validate_crcs=True)
        summary = reader.get_summary()
        assert summary is not None
        self.summary = summary
        self.by_topic: dict[str, list[Any]] = {}
        self.schemas: dict[str, dict[str, Any]] = {}
        self.names: dict[str, str] = {}
        self.frames: list[bytes] = []
        for schema, channel, message in reader.iter_messages():
            if schema is None:
                assert channel.message_encoding == ENCODING
                self.frames.append(message.data)
                continue
            assert (schema.encoding, channel.message_encoding) == ("jsonschema", "json")
            self.by_topic.setdefault(channel.topic, []).append(json.loads(message.data))
            self.schemas[channel.topic] = json.loads(schema.data)
            self.names[channel.topic] = schema.name
        self.metadata = {one.name: one.metadata for one in reader.iter_metadata()}


@pytest.fixture
def frames_sent() -> list[PublishedFrame]:
    return list(run())


@pytest.fixture
def found(tmp_path: Path, frames_sent: list[PublishedFrame]) -> Found:
    return Found(mcap(tmp_path / "a.mcap", frames_sent))


def test_messages_match_the_schema_of_their_channel(found: Found) -> None:
    for topic, messages in found.by_topic.items():
        schema = found.schemas[topic]
        assert schema["title"] == found.names[topic]
        problems = [problem(schema, message, topic) for message in messages]
        assert problems == [""] * len(messages)


def test_drawings_use_foxglove_schema_names(found: Found) -> None:
    drawn = {topic: name for topic, name in found.names.items() if name.startswith("foxglove.")}
    assert set(drawn.values()) == set(FOXGLOVE)
    for topic, name in drawn.items():
        assert all(set(message) == FOXGLOVE[name] for message in found.by_topic[topic])
    for update in (*found.by_topic["/world"], *found.by_topic["/sonar/rays"]):
        assert all(set(entity) == ENTITY for entity in update["entities"])


def test_every_message_is_also_decoded(found: Found, frames_sent: list[PublishedFrame]) -> None:
    decoded = found.by_topic["/tlm/odometry/PlanarOdometry"]
    assert [one["x_m"] for one in decoded][:2] == [0.6000000238418579, 0.6000000238418579]
    assert found.frames == [one.frame for one in frames_sent]
    (goal,) = found.by_topic["/tlm/commanded/GoalRequest"]
    assert goal["x_mm"] == 5400


def test_header_names_robot_and_build(found: Found) -> None:
    assert found.metadata["sidestep"]["robot"] == "r1"
    assert found.metadata["sidestep"]["commit"] == "c0ffee"
    assert json.loads(found.metadata["world"]["json"])["name"] == "made"


def test_each_batch_is_one_chunk(found: Found, frames_sent: list[PublishedFrame]) -> None:
    assert len(found.summary.chunk_indexes) == len(frames_sent) // 30 + 1


def test_json_has_null_for_values_that_are_not_finite() -> None:
    form = McapFormat("r1", {})
    nowhere = decision(0, (float("nan"), float("inf")))
    form.add("sidestep/r1/tlm/decision", Encoder(1, 1).encode(nowhere), 1)
    reader = make_reader(io.BytesIO(form.end()))
    (shown,) = [
        json.loads(message.data)
        for _, channel, message in reader.iter_messages()
        if AvoidanceDecision.__name__ in channel.topic
    ]
    assert shown["virtual_x_m"] is None
    assert shown["virtual_y_m"] is None
    assert shown["nearest_range_m"] == pytest.approx(0.8)


def test_unknown_message_is_kept_raw() -> None:
    foreign = bytes([0xFD, 1, 0, 0, 0, 1, 1, 0x11, 0x22, 0x33, 7, 0, 0])
    form = McapFormat("r1", {})
    form.add("sidestep/r1/tlm/new", foreign, 1)
    reader = make_reader(io.BytesIO(form.end()))
    assert [channel.topic for _, channel, _ in reader.iter_messages()] == [
        "/mavlink/key",
        "/mavlink",
    ]


def test_cached_sample_keeps_its_publish_time() -> None:
    form = McapFormat("r1", {})
    frame = Encoder(1, 1).encode(Statustext(severity=6, text="earlier"))
    form.add("sidestep/r1/tlm/text", frame, 5_000_000, 2_000_000)
    reader = make_reader(io.BytesIO(form.end()))
    for _, _, message in reader.iter_messages():
        assert (message.log_time, message.publish_time) == (5_000_000_000, 2_000_000_000)


def test_index_entries_stay_small_in_memory(
    frames_sent: list[PublishedFrame],
) -> None:
    """Limit the growth to half a kilobyte a batch, which is 3.5 MB an hour."""
    form = McapFormat("r1", {})

    def batches(count: int) -> None:
        for _ in range(count):
            for one in frames_sent[:70]:
                form.add(one.key, one.frame, one.time_us)
            form.batch()
        gc.collect()

    tracemalloc.start()
    try:
        batches(10)
        before, _ = tracemalloc.get_traced_memory()
        batches(40)
        after, _ = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert (after - before) / 40 < 500


def test_messages_of_a_topic_are_numbered(tmp_path: Path) -> None:
    data = mcap(tmp_path / "a.mcap", list(run(20))).read_bytes()
    numbers: dict[str, list[int]] = {}
    for _, channel, message in make_reader(io.BytesIO(data)).iter_messages(log_time_order=False):
        numbers.setdefault(channel.topic, []).append(message.sequence)
    assert len(numbers["/mavlink"]) > 100
    assert all(found == list(range(len(found))) for found in numbers.values())


def test_foreign_keys_create_no_channels() -> None:
    """Create no channel for keys of operator sessions or of foreign publishers."""
    form = McapFormat("r1", {})
    text = Encoder(1, 1).encode(Statustext(severity=6, text="x"))
    for number in range(500):
        form.add(f"sidestep/r1/op/mark/open/{number:x}", text, number)
        form.add(f"sidestep/r1/strange/{number}", text, number)
    assert len(form._channels) == 4  # raw, its key, the mark, and the log of the viewer
    assert len(form._splitter._drawer._texts) <= 64


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


DUAL_WRITER = """
import sys
import threading
from datetime import UTC, datetime
from pathlib import Path
from ground.recording.log_writer import DualLog
from tests.support.ground.made_recordings import run
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
        [sys.executable, "-c", DUAL_WRITER, str(folder)], stdout=subprocess.PIPE, text=True
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


class Stage:
    """A bus that serves the given answers."""

    def __init__(self) -> None:
        self.answers: dict[str, Message | bytes] = {}
        self.requested: list[str] = []
        self.needs_s = 0.0

    def ask(
        self,
        service: Service,
        message: Message | None = None,
        timeout_s: float = 0.5,
        robot: str | None = None,
    ) -> Message | bytes:
        assert (message, robot) == (None, "r1")
        self.requested.append(service.path)
        if service.path not in self.answers:
            raise NoAnswerError("no process answers")
        if self.needs_s > timeout_s:
            raise NoAnswerError("no answer in time")
        return self.answers[service.path]


def test_each_fact_is_returned_once() -> None:
    stage = Stage()
    facts = MetadataReader(stage, "r1")
    assert facts.poll(0) == {}
    stage.answers[PARAMETERS.path] = b"[]"
    assert facts.poll(1 * S) == {"parameters": "[]"}
    stage.answers[WORLD.path] = b"{}"
    assert facts.poll(10 * S) == {"world": "{}"}
    stage.requested.clear()
    assert facts.poll(100 * S) == {}
    assert stage.requested == []


def test_missing_facts_are_requested_at_the_end() -> None:
    stage = Stage()
    facts = MetadataReader(stage, "r1")
    assert facts.poll(0) == {}
    stage.answers = {PARAMETERS.path: b"[]", WORLD.path: b"{}"}
    assert facts.poll(S // 10) == {}  # not due
    assert facts.request_missing() == {"parameters": "[]", "world": "{}"}
    assert facts.request_missing() == {}


def test_a_busy_machine_and_the_end_of_a_recording_get_more_time() -> None:
    for busy, needs_s in ((4.0, 0.7), (1.0, 0.9)):
        stage = Stage()
        stage.answers, stage.needs_s = {PARAMETERS.path: b"[]", WORLD.path: b"{}"}, needs_s
        facts = MetadataReader(stage, "r1", partial(float, busy))
        found = facts.poll(0)
        assert len(found) == (2 if busy > 1.0 else 0)
        assert len(found | facts.request_missing()) == 2


def test_requests_are_rate_limited() -> None:
    stage = Stage()
    facts = MetadataReader(stage, "r1")
    for tick in range(240):
        facts.poll(tick * S // 4)
    assert len(stage.requested) < 40


def test_malformed_answer_is_ignored() -> None:
    stage = Stage()
    stage.answers = {WORLD.path: b"\xff\xfe", PARAMETERS.path: Statustext(severity=1, text="no")}
    assert MetadataReader(stage, "r1").poll(0) == {}
