"""A long run is recorded in parts, which are one recording for whoever lists or reads it."""

import errno
import json
import os
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path
from zipfile import ZipFile

import pytest

from ground.client.operations.session import NoProgress
from ground.recording.catalogue import (
    Retention,
    newest,
    part_bytes,
    recordings_in,
    size_of,
    size_of_run,
)
from ground.recording.log_reader import (
    SUFFIXES,
    LoggedFrame,
    LogIndex,
    files_of,
    is_locked,
    is_running,
    number_of,
    open_log,
    part_of,
    parts_of,
    run_of,
)
from ground.recording.log_writer import DualLog, LogFile
from ground.recording.summary import summary_of
from ground.reports.share import Share
from runtime.errors import UserError
from tests.support.each import each
from tests.support.ground.recording.made import WORLD_TEXT, PublishedFrame, run
from tests.support.until import until

NOON = datetime(2026, 3, 4, 12, 0, 5, tzinfo=UTC)
NAME = "20260304T120005Z-r1"
PART_BYTES = 8_000


class Recorder:
    """A run whose parts end at a small size, or when the test says that time has passed."""

    def __init__(self, folder: Path, part_bytes: int = PART_BYTES, part_s: float = 3600.0) -> None:
        self.now_s = 0.0
        self.folder = folder
        self.frames = list(run())
        self.round = 0
        self.log = DualLog.new(
            folder,
            "r1",
            NOON,
            0,
            part_bytes=part_bytes,
            part_s=part_s,
            now_s=lambda: self.now_s,
        )

    def feed(self, frames: list[PublishedFrame], each_round: Callable[[], object] = int) -> None:
        for number, one in enumerate(frames, 1):
            self.log.take(one.key, one.frame, one.time_us * 1000)
            if number % 10 == 0:
                self.round += 1
                self.log.flush(self.round, sync_every=4)
                each_round()

    def all(self) -> "Recorder":
        self.log.add_fact("world", WORLD_TEXT)
        self.feed(self.frames)
        assert self.log.close()
        return self


def whole(folder: Path) -> list[LoggedFrame]:
    """Return the frames of the same run in one part."""
    recorder = Recorder(folder / "whole", 10**9).all()
    assert recorder.log.parts == 1
    return list(open_log(recorder.log.path))


@each("suffix", SUFFIXES)
def test_no_frame_is_lost_or_doubled_where_a_part_ends(suffix: str, tmp_path: Path) -> None:
    folder = tmp_path / suffix
    recorder = Recorder(folder).all()
    assert recorder.log.parts > 3
    assert len(files_of(recorder.log.path)) == 2 * recorder.log.parts
    for part in parts_of(recorder.log.path):
        log = open_log(part.with_suffix(suffix))
        facts, frames, shares = log.facts, [], [log.share]
        for one in log:
            frames.append(one)
            shares.append(log.share)
        assert frames == whole(folder)
        assert shares == sorted(shares)
        assert (log.damage(), log.records, log.share) == ("", len(recorder.frames), 1.0)
        assert json.loads(facts["world"])["name"] == "made", "they are known after reading"


def test_each_part_can_be_read_alone(tmp_path: Path) -> None:
    """A part that was copied, or is the only one that is left, knows its world and its keys."""
    recorder = Recorder(tmp_path / "run").all()
    frames: list[LoggedFrame] = []
    for part in parts_of(recorder.log.path.with_suffix(".mcap")):
        alone = tmp_path / f"{number_of(part)}" / part.name
        alone.parent.mkdir()
        alone.write_bytes(part.read_bytes())
        log = open_log(alone)
        frames += log
        assert log.damage() == ""
        assert json.loads(log.facts["world"])["name"] == "made"
    assert frames == whole(tmp_path)


def test_part_ends_after_an_hour(tmp_path: Path) -> None:
    recorder = Recorder(tmp_path, 10**9)
    for hours in (0.5, 0.99, 1.0, 1.99, 2.0):
        recorder.now_s = hours * 3600
        recorder.feed(recorder.frames[:10])
    assert recorder.log.parts == 3
    recorder.log.close()


def test_both_kinds_end_together_at_their_sum(tmp_path: Path) -> None:
    recorder = Recorder(tmp_path).all()
    parts = [parts_of(track.path) for track in recorder.log.tracks]
    assert [part.stem for part in parts[0]] == [part.stem for part in parts[1]]
    sums = [size_of(tlog) + size_of(mcap) for tlog, mcap in zip(*parts, strict=True)]
    assert min(sums[:-1]) >= PART_BYTES


def test_run_is_listed_once(tmp_path: Path) -> None:
    recorder = Recorder(tmp_path)
    recorder.log.add_fact("world", WORLD_TEXT)
    recorder.feed(recorder.frames)
    (path,) = recordings_in(tmp_path)
    assert path.name == f"{NAME}.mcap"
    assert is_running(path)
    assert summary_of(path).is_running
    with pytest.raises(UserError, match="still being recorded"):
        newest(tmp_path, 1)
    recorder.log.close()
    found, one = summary_of(path), summary_of(next(iter(whole_in(tmp_path))))
    assert not found.is_running
    assert found._replace(path=one.path, size=0) == one._replace(size=0)
    assert found.size == sum(map(size_of, tmp_path.glob("2026*")))
    assert found.length_s
    assert newest(tmp_path, 1) == path


def whole_in(folder: Path) -> list[Path]:
    whole(folder)
    return recordings_in(folder / "whole")


def test_kept_part_of_a_run_stands_for_it(tmp_path: Path) -> None:
    recorder = Recorder(tmp_path).all()
    frames = list(open_log(recorder.log.path))
    for part in parts_of(recorder.log.path)[:2]:
        for path in (part, part.with_suffix(".mcap")):
            path.unlink()
    (path,) = recordings_in(tmp_path)
    assert path.name == f"{NAME}.part003.mcap"
    log = open_log(tmp_path / f"{NAME}.mcap")
    kept = list(log)
    assert kept == frames[-len(kept) :]
    assert log.damage() == ""
    assert summary_of(path).began == NOON
    assert len(LogIndex(open_log(path))) == len(kept)


def test_gap_in_the_middle_is_damage(tmp_path: Path) -> None:
    recorder = Recorder(tmp_path).all()
    part_of(recorder.log.path, 2).unlink()
    log = open_log(recorder.log.path)
    assert len(list(log)) < len(recorder.frames)
    assert log.damage() == "part 2: is missing"


def test_all_parts_are_shared(tmp_path: Path) -> None:
    recorder = Recorder(tmp_path).all()
    out = tmp_path / "drive.zip"
    Share(file=str(recorder.log.path), out=str(out)).run(NoProgress())
    with ZipFile(out) as archive:
        names = [name for name in archive.namelist() if name.startswith(NAME)]
        archive.extractall(tmp_path / "there")
    assert sorted(names) == sorted(path.name for path in files_of(recorder.log.path))
    assert list(open_log(tmp_path / "there" / f"{NAME}.mcap")) == list(open_log(recorder.log.path))


def test_limit_bounds_a_run_while_it_is_recorded(tmp_path: Path) -> None:
    limit = 40_000
    recorder = Recorder(tmp_path, part_bytes(limit))
    retention = Retention(tmp_path, limit, part_bytes(limit))
    frames, sizes, told = recorder.frames, list[int](), list[str]()

    def tidy() -> None:
        parts = parts_of(recorder.log.path)[:-1]
        until(lambda: not any(map(is_locked, parts)), what="a closed part")
        told.append(retention.delete_oldest())
        sizes.append(sum(map(size_of, tmp_path.iterdir())))

    for _ in range(4):
        recorder.feed(frames, tidy)
    assert max(sizes) <= limit
    assert min(sizes[len(sizes) // 2 :]) >= limit / 2, "it keeps what it may"
    assert next(filter(None, told)).startswith("deleted the oldest parts of what is recorded in")
    assert recorder.log.close()
    (path,) = recordings_in(tmp_path)
    assert number_of(path) > 10
    log = open_log(path)
    newest_frames = list(log)
    assert [one.frame for one in newest_frames][-10:] == [one.frame for one in frames[-10:]]
    assert log.damage() == ""


def test_parts_are_deleted_by_age_over_all_runs(tmp_path: Path) -> None:
    """A long run of one robot is not deleted before older parts of another."""
    for number, (name, at_s) in enumerate(
        [("r1", 10), ("r1.part002", 30), ("r2", 20), ("r2.part002", 40)]
    ):
        path = tmp_path / f"20260304T12000{number // 2}Z-{name}.tlog"
        path.write_bytes(b"x" * 100)
        os.utime(path, (at_s, at_s))
    Retention(tmp_path, 250).delete_oldest()
    assert [path.name[16:] for path in sorted(tmp_path.iterdir())] == [
        "-r1.part002.tlog",
        "-r2.part002.tlog",
    ]


def test_full_disk_begins_no_part_and_loses_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    recorder = Recorder(tmp_path)
    recorder.feed(recorder.frames[:100])
    parts = recorder.log.parts
    real_append = LogFile.append

    def full(log: LogFile, batch: bytes) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(LogFile, "append", full)
    recorder.now_s = 7200.0
    recorder.feed(recorder.frames[100:200])
    assert recorder.log.parts == parts
    monkeypatch.setattr(LogFile, "append", real_append)
    recorder.feed(recorder.frames[200:])
    assert recorder.log.parts > parts
    assert recorder.log.close()
    assert len(list(open_log(recorder.log.path))) == len(recorder.frames)


def test_name_in_the_way_of_a_part_leaves_the_run_in_its_files(tmp_path: Path) -> None:
    recorder = Recorder(tmp_path)
    part_of(recorder.log.tracks[1].path, 2).touch()
    recorder.feed(recorder.frames)
    assert recorder.log.close()
    assert recorder.log.parts == 1
    assert not part_of(recorder.log.path, 2).exists()


def test_size_of_a_growing_run_grows_over_its_parts(tmp_path: Path) -> None:
    recorder, sizes = Recorder(tmp_path), list[int]()
    recorder.feed(recorder.frames, lambda: sizes.append(size_of_run(recorder.log.path)))
    recorder.log.close()
    assert sizes == sorted(sizes)
    assert recorder.log.parts > 3


@each(
    ("name", "run", "number"),
    [
        ("20260304T120005Z-r1", "20260304T120005Z-r1", 1),
        ("20260304T120005Z-r1.2", "20260304T120005Z-r1.2", 1),
        ("20260304T120005Z-r1.2.part003", "20260304T120005Z-r1.2", 3),
        ("20260304T120005Z-r1.part1000", "20260304T120005Z-r1", 1000),
        ("drive.part002", "drive.part002", 1),
        ("20260304T120005Z-r1.part2", "20260304T120005Z-r1.part2", 1),
    ],
)
def test_name_of_a_part(name: str, run: str, number: int) -> None:
    path = Path("there") / f"{name}.tlog"
    assert (run_of(path), number_of(path)) == (Path("there") / run, number)
    assert parts_of(path) == [path]
    if number > 1:
        assert part_of(part_of(path, 1), number) == path
