"""The MCAP library reads recordings, and drawings have Foxglove's schemas."""

import gc
import io
import json
import tracemalloc
from pathlib import Path
from typing import Any

import pytest
from mcap.reader import make_reader

from ground.recording.mcap_file import McapFormat
from protocol.topics import ENCODING
from protocol.wire.codec import Encoder
from protocol.wire.messages import AvoidanceDecision, Statustext
from tests.support.ground.recording.json_schema import problem
from tests.support.ground.recording.made import PublishedFrame, decision, mcap, run

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
        batches(20)
        before, _ = tracemalloc.get_traced_memory()
        batches(100)
        after, _ = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert (after - before) / 100 < 500


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
