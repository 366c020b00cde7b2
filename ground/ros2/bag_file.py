"""Write bags of ROS 2: a folder of MCAP files with the profile ros2, and their metadata.yaml.

The files are readable at any time: each batch is written over the index at the end of the file,
with the new index behind it. After a kill only what came since the last batch is missing; a kill in
the middle of a write leaves a file that `mcap recover` repairs. A part begins with the newest
messages of latched topics, so that it can be read without the parts before it.
"""

import json
import os
import re
import shutil
import zlib
from collections.abc import Iterator, Sequence
from contextlib import suppress
from datetime import UTC, datetime
from functools import cache
from itertools import count
from pathlib import Path
from typing import Any, Final, NamedTuple

import zstandard
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Channel,
    Chunk,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    Message,
    MessageIndex,
    Schema,
    Statistics,
    SummaryOffset,
)
from rosbags.typesys import Stores, get_typestore

from ground.recording.catalogue import size_of
from ground.recording.log_reader import is_locked
from ground.recording.log_writer import DualLog, LogFile, LogWriter, Track
from ground.recording.mcap_file import LIBRARY, MAGIC, IndexEntry
from ground.ros2.offer import Qos, RosTopic
from runtime.files import replace
from runtime.units import NS_PER_US

STORE: Final = get_typestore(Stores.ROS2_JAZZY)
DISTRO: Final = "jazzy"
"""The definitions of common messages are the same in later distributions."""

VERSION: Final = 9
METADATA: Final = "metadata.yaml"
CHUNK_BYTES: Final = 1 << 20
EVERY: Final = 8
"""Number of rounds of a recorder between two batches: two seconds."""

PART_S: Final = 600.0
"""Age at which a part ends: its index, which is written with each batch, grows with the part."""

NAMED: Final = re.compile(r"\d{8}T\d{6}Z-ros2(\.\d+)?\Z")
"""Names of the bags that recorders make."""

FOREVER: Final = "{sec: 9223372036, nsec: 854775807}"


def encoded(topic: RosTopic, message: object) -> bytes:
    """Return the bytes of a message, in little-endian CDR."""
    return bytes(STORE.serialize_cdr(message, topic.type_name, little_endian=True))


@cache
def definition_of(type_name: str) -> tuple[str, str]:
    """Return text and hash of a type, with the types that it contains."""
    return STORE.generate_msgdef(type_name, ros_version=2)[0], STORE.hash_rihs01(type_name)


def qos_lines(qos: Qos) -> list[str]:
    """Return the YAML of the one offered profile."""
    lifespan = f"{{sec: {qos.lifespan_s}, nsec: 0}}" if qos.lifespan_s else FOREVER
    return [
        "- history: keep_last",
        f"  depth: {qos.depth}",
        f"  reliability: {'reliable' if qos.is_reliable else 'best_effort'}",
        f"  durability: {'transient_local' if qos.is_latched else 'volatile'}",
        f"  deadline: {FOREVER}",
        f"  lifespan: {lifespan}",
        "  liveliness: automatic",
        f"  liveliness_lease_duration: {FOREVER}",
        "  avoid_ros_namespace_conventions: false",
    ]


class Content(NamedTuple):
    """What a file holds: number of messages by topic, and the times of the first and last one."""

    counts: dict[str, int]
    begin_ns: int
    end_ns: int

    @property
    def total(self) -> int:
        """Number of messages."""
        return sum(self.counts.values())

    @property
    def duration_ns(self) -> int:
        """Time between the first and the last message."""
        return max(0, self.end_ns - self.begin_ns)


EMPTY: Final = Content({}, 0, 0)


class BagFormat:
    """Turns messages into chunks with their indexes; `key` is the absolute name of a topic."""

    def __init__(self, bag: "Bag", begins_us: int = 0) -> None:
        self._bag = bag
        self._written = 0
        self._head = MAGIC + packed(Header(profile="ros2", library=LIBRARY))
        self._schemas: dict[str, Schema] = {}
        self._channels: dict[str, Channel] = {}
        self._counts: dict[str, int] = {}
        self._chunks: list[IndexEntry] = []
        self._begin_ns = self._end_ns = 0
        self._begin_chunk()
        for name, data in bag.latched.items():
            self.add(name, data, begins_us, begins_us)

    def _begin_chunk(self) -> None:
        self._chunk: Any = RecordBuilder()
        self._indexes: dict[int, list[tuple[int, int]]] = {}
        self._times_ns = (1 << 63, 0)

    @property
    def waiting_bytes(self) -> int:
        """Number of bytes since the last batch."""
        return int(self._chunk.count)

    @property
    def content(self) -> Content:
        """What was added so far."""
        return Content(dict(self._counts), self._begin_ns, self._end_ns)

    def add(self, key: str, frame: bytes, time_us: int, published_us: int) -> None:
        """Add a message of a topic of the bag."""
        channel, time_ns = self._channel(key), time_us * NS_PER_US
        if self._bag.topics[key].qos.is_latched and self._bag.topics[key].qos.depth == 1:
            self._bag.latched[key] = frame
        self._indexes.setdefault(channel.id, []).append((time_ns, self._chunk.count))
        before = self._counts.get(key, 0)
        Message(
            channel_id=channel.id,
            log_time=time_ns,
            data=frame,
            publish_time=published_us * NS_PER_US,
            sequence=before + 1,
        ).write(self._chunk)
        self._begin_ns = time_ns if not self._counts else min(time_ns, self._begin_ns)
        self._end_ns = max(self._end_ns, time_ns)
        self._counts[key] = before + 1
        self._times_ns = min(self._times_ns[0], time_ns), max(self._times_ns[1], time_ns)

    def add_fact(self, name: str, text: str) -> None:
        """Ignore a fact: a bag holds messages only."""

    def batch(self) -> bytes:
        """Return everything since the last batch as one chunk, and in front of the first the head.

        A chunk without messages is not written.
        """
        head, self._head = self._head, b""
        if not self._indexes:
            self._written += len(head)
            return head
        plain: bytes = self._chunk.end()
        data = zstandard.compress(plain)
        begin_ns, end_ns = self._times_ns
        chunk = packed(
            Chunk(
                compression="zstd",
                data=data,
                message_start_time=begin_ns,
                message_end_time=end_ns,
                uncompressed_crc=zlib.crc32(plain),
                uncompressed_size=len(plain),
            )
        )
        place = self._written + len(head)
        offsets: dict[int, int] = {}
        index: Any = RecordBuilder()
        for number, records in self._indexes.items():
            offsets[number] = place + len(chunk) + index.count
            MessageIndex(channel_id=number, records=records).write(index)
        indexes: bytes = index.end()
        entry = ChunkIndex(
            chunk_length=len(chunk),
            chunk_start_offset=place,
            compression="zstd",
            compressed_size=len(data),
            message_end_time=end_ns,
            message_index_length=len(indexes),
            message_index_offsets=offsets,
            message_start_time=begin_ns,
            uncompressed_size=len(plain),
        )
        self._chunks.append(IndexEntry(entry))
        self._begin_chunk()
        batch = head + chunk + indexes
        self._written += len(batch)
        return batch

    def end(self) -> bytes:
        """Return the rest of the messages; the index follows with each batch."""
        return self.batch()

    def tail(self) -> bytes:
        """Return what follows the batches so far: the index, and the end of the file."""
        tail: Any = RecordBuilder()
        DataEnd(data_section_crc=0).write(tail)
        begin = tail.count
        offsets: list[SummaryOffset] = []
        statistics = Statistics(
            attachment_count=0,
            channel_count=len(self._channels),
            channel_message_counts={
                channel.id: self._counts[name] for name, channel in self._channels.items()
            },
            chunk_count=len(self._chunks),
            message_count=sum(self._counts.values()),
            message_end_time=self._end_ns,
            message_start_time=self._begin_ns,
            metadata_count=0,
            schema_count=len(self._schemas),
        )
        groups: list[tuple[Opcode, Sequence[Any]]] = [
            (Opcode.SCHEMA, list(self._schemas.values())),
            (Opcode.CHANNEL, list(self._channels.values())),
            (Opcode.STATISTICS, [statistics]),
            (Opcode.CHUNK_INDEX, self._chunks),
        ]
        for opcode, records in groups:
            start = tail.count
            for record in records:
                record.write(tail)
            if records:
                place, length = self._written + start, tail.count - start
                offsets.append(SummaryOffset(opcode, group_length=length, group_start=place))
        summary_offsets = self._written + tail.count
        for offset in offsets:
            offset.write(tail)
        Footer(
            summary_start=self._written + begin,
            summary_offset_start=summary_offsets,
            summary_crc=0,
        ).write(tail)
        end: bytes = tail.end()
        return end + MAGIC

    def _channel(self, name: str) -> Channel:
        """Return the channel of a topic, which is declared in the chunk of its first message."""
        channel = self._channels.get(name)
        if channel is None:
            topic = self._bag.topics[name]
            schema = self._schema(topic.type_name)
            channel = self._channels[name] = Channel(
                id=len(self._channels) + 1,
                topic=name,
                message_encoding="cdr",
                schema_id=schema.id,
                metadata={
                    "offered_qos_profiles": "\n".join(qos_lines(topic.qos)),
                    "topic_type_hash": definition_of(topic.type_name)[1],
                },
            )
            channel.write(self._chunk)
        return channel

    def _schema(self, type_name: str) -> Schema:
        schema = self._schemas.get(type_name)
        if schema is None:
            text = definition_of(type_name)[0].encode()
            number = len(self._schemas) + 1
            schema = Schema(id=number, name=type_name, encoding="ros2msg", data=text)
            self._schemas[type_name] = schema
            schema.write(self._chunk)
        return schema


def packed(record: McapRecord) -> bytes:
    """Return the bytes of a record."""
    builder: Any = RecordBuilder()
    record.write(builder)
    data: bytes = builder.end()
    return data


class BagFile(LogFile):
    """A file that ends with its index after each batch."""

    def __init__(self, path: Path, bag: "Bag", form: BagFormat) -> None:
        super().__init__(path)
        self.content = EMPTY
        self._bag, self._form, self._tail = bag, form, b""

    def append(self, batch: bytes) -> None:
        """Write a batch and the index, or raise OSError and leave the file as it was."""
        tail = self._form.tail()
        try:
            self.put(batch + tail, self.size)
        except OSError:
            self.put(self._tail, self.size)  # the room for it is still allocated
            os.ftruncate(self._fd, self.size + len(self._tail))
            raise
        self.size += len(batch)
        self.content, self._tail = self._form.content, tail

    def sync(self) -> None:
        """Flush the data to the disk, and renew what metadata.yaml says about them."""
        super().sync()
        self._bag.describe()


class Bag:
    """One bag: a folder with files that follow each other.

    Add a topic to `topics` before its first message. With `keep_bytes` the oldest files are deleted
    when a new one begins.
    """

    def __init__(self, path: Path, keep_bytes: int | None = None) -> None:
        """Create the folder; OSError if that fails, as it does when it exists."""
        path.mkdir(parents=True)
        self.path = path
        self.topics: dict[str, RosTopic] = {}
        self.latched: dict[str, bytes] = {}
        """The newest message of each topic that is latched."""

        self.files: list[BagFile] = []
        self._keep_bytes = keep_bytes

    def begin(self, number: int, begins_us: int = 0) -> tuple[BagFile, BagFormat]:
        """Begin a file, with a number from 1 on; OSError if it cannot be created."""
        form = BagFormat(self, begins_us)
        file = BagFile(self.path / f"{self.path.name}_{number - 1}.mcap", self, form)
        try:
            file.append(form.batch())
        except OSError:
            file.close()
            file.path.unlink(missing_ok=True)
            raise
        self.files.append(file)
        self._delete_oldest()
        return file, form

    def _delete_oldest(self) -> None:
        """Delete the oldest bags beside this one, then the oldest files of this one."""
        if self._keep_bytes is None:
            return
        others = sorted(
            path
            for path in self.path.parent.iterdir()
            if NAMED.match(path.name) and path != self.path and path.is_dir()
        )
        sizes = {path: sum(map(size_of, path.glob("*.mcap"))) for path in others}
        own = sum(size_of(file.path) for file in self.files)
        for path in others:
            if own + sum(sizes.values()) <= self._keep_bytes:
                return
            if not any(map(is_locked, path.glob("*.mcap"))):
                shutil.rmtree(path, ignore_errors=True)
                del sizes[path]
        while own > self._keep_bytes and len(self.files) > 1:
            oldest = self.files.pop(0).path
            own -= size_of(oldest)
            with suppress(OSError):
                oldest.unlink(missing_ok=True)

    def describe(self) -> None:
        """Write metadata.yaml; what the files hold can be read without it."""
        with suppress(OSError):
            replace(self.path / METADATA, metadata(self.topics, tuple(self.files)))


def new_bag(folder: Path, began: datetime, keep_bytes: int | None) -> Bag:
    """Create a bag with a new name in a folder, and the folder if needed; OSError on failure."""
    stem = f"{began.astimezone(UTC):%Y%m%dT%H%M%SZ}-ros2"
    for number in count():
        with suppress(FileExistsError):
            return Bag(folder / f"{stem}{f'.{number}' if number else ''}", keep_bytes)
    raise AssertionError("endless")


def bag_log(bag: Bag, *, part_bytes: int, part_s: float) -> DualLog:
    """Return the writer of a bag; it takes the name of a topic, a message, and its time in UTC."""
    file, form = bag.begin(1)
    writer = LogWriter(file, 0, form=form, accepts=lambda name, _: name in bag.topics)
    track = Track(file.path, writer, EVERY, bag.begin)
    return DualLog((track,), part_bytes=part_bytes, part_s=part_s)


def metadata(topics: dict[str, RosTopic], files: Sequence[BagFile]) -> str:
    """Return the text of metadata.yaml, in version 9."""
    contents = [file.content for file in files]
    filled = [one for one in contents if one.counts] or [EMPTY]
    begin_ns = min(one.begin_ns for one in filled)
    whole = Content({}, begin_ns, max(one.end_ns for one in filled))
    lines = [
        "rosbag2_bagfile_information:",
        f"  version: {VERSION}",
        "  storage_identifier: mcap",
        *times(whole, "  "),
        f"  message_count: {sum(one.total for one in contents)}",
        "  topics_with_message_count:",
    ]
    for name, topic in tuple(topics.items()):
        if total := sum(one.counts.get(name, 0) for one in contents):
            lines += [
                "    - topic_metadata:",
                f"        name: {name}",
                f"        type: {topic.type_name}",
                "        serialization_format: cdr",
                "        offered_qos_profiles:",
                *(f"          {line}" for line in qos_lines(topic.qos)),
                f"        type_description_hash: {definition_of(topic.type_name)[1]}",
                f"      message_count: {total}",
            ]
    names = [json.dumps(file.path.name) for file in files]
    lines += ['  compression_format: ""', '  compression_mode: ""', "  relative_file_paths:"]
    lines += [f"    - {name}" for name in names]
    lines += ["  files:"]
    for name, one in zip(names, contents, strict=True):
        lines += [f"    - path: {name}", *times(one, "      ")]
        lines += [f"      message_count: {one.total}"]
    return "\n".join([*lines, "  custom_data: ~", f"  ros_distro: {DISTRO}", ""])


def times(content: Content, indent: str) -> Iterator[str]:
    """Yield the lines of a begin and a duration."""
    yield f"{indent}starting_time:"
    yield f"{indent}  nanoseconds_since_epoch: {content.begin_ns}"
    yield f"{indent}duration:"
    yield f"{indent}  nanoseconds: {content.duration_ns}"
