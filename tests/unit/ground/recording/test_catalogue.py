"""The recordings that are kept: found by number, in parts, and deleted beyond a limit."""

import errno
import json
import os
import shutil
from collections.abc import Callable, Iterator
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from zipfile import ZipFile

import pytest

import study.cli.reexecute
from checks.harness.until import until
from ground.cli.main import main, parse
from ground.client.outcomes import NoProgress
from ground.commands.command import Reach, command_in, parsed
from ground.commands.explain import Explain
from ground.commands.share import Share
from ground.launch.recording_session import DEFAULT_KEEP, byte_limit
from ground.recording.catalogue import (
    LOW_BYTES,
    Retention,
    began,
    newest,
    part_bytes,
    recording_named,
    recordings_in,
    size_in,
    size_of,
    size_of_run,
    size_text,
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
from ground.recording.log_writer import DualLog, LogFile, new_log
from ground.recording.summary import summary_of
from ground.user.folders import recordings_folder
from protocol.wire.messages import NavigatorStatus
from runtime.errors import UserError
from tests.support.each import each
from tests.support.ground.made_recordings import (
    PERIOD_US,
    WORLD_TEXT,
    PublishedFrame,
    mcap,
    run,
    tlog,
    written,
)

OLD, MIDDLE, NEW = (f"20261123T10000{second}Z-r1" for second in (1, 2, 3))


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    monkeypatch.chdir(tmp_path)
    recordings_folder().mkdir(parents=True)
    return recordings_folder()


@pytest.fixture
def three(folder: Path) -> Path:
    """Two complete recordings and one without its .mcap, with times that lie."""
    frames = list(run(40))
    for stem in (OLD, MIDDLE, NEW):
        tlog(folder / f"{stem}.tlog", frames)
        mcap(folder / f"{stem}.mcap", frames)
        os.utime(folder / f"{stem}.mcap", (0, 0))
    (folder / f"{MIDDLE}.mcap").unlink()
    (folder / "notes.txt").write_text("no recording")
    return folder


@pytest.mark.usefixtures("folder")
def test_each_recording_is_listed_once_and_the_newest_first(three: Path) -> None:
    names = [path.name for path in recordings_in(three)]
    assert names == [f"{NEW}.mcap", f"{MIDDLE}.tlog", f"{OLD}.mcap"]
    assert recordings_in(three / "missing") == []


@pytest.mark.usefixtures("folder")
def test_folders_below_are_listed_on_request(three: Path) -> None:
    assert recordings_in(three.parent) == []
    assert len(recordings_in(three.parent, below=True)) == 3


@pytest.mark.usefixtures("folder")
def test_a_file_without_a_time_in_its_name_has_that_of_the_file(tmp_path: Path) -> None:
    for name in ("a.tlog", "20269999T999999Z-r1.tlog"):
        (tmp_path / name).touch()
        os.utime(tmp_path / name, (60, 60))
        assert began(tmp_path / name).isoformat() == "1970-01-01T00:01:00+00:00"


@pytest.mark.usefixtures("folder")
@pytest.mark.parametrize(("word", "stem"), [(None, NEW), ("-1", NEW), ("-2", MIDDLE), ("-3", OLD)])
def test_recordings_are_named_from_the_newest(three: Path, word: str | None, stem: str) -> None:
    assert recording_named(word).stem == stem


@pytest.mark.usefixtures("folder")
def test_a_folder_is_its_newest_and_a_file_is_itself(three: Path, tmp_path: Path) -> None:
    assert recording_named(str(three)).stem == NEW
    assert recording_named("drive.mcap") == Path("drive.mcap")
    (tmp_path / "-2").touch()
    assert recording_named("-2") == Path("-2")


@pytest.mark.usefixtures("folder")
def test_what_is_not_there_is_refused_with_the_next_command(folder: Path) -> None:
    with pytest.raises(UserError, match="there is no recording; `sidestep up` makes one"):
        recording_named(None)
    tlog(folder / f"{OLD}.tlog", list(run(4)))
    with pytest.raises(UserError, match="-2: there are only 1 recordings"):
        recording_named("-2")


@pytest.mark.usefixtures("folder")
@pytest.mark.parametrize(
    "words", [["replay", "--plain"], ["plot"], ["explain", "--turns"], ["share"]]
)
def test_verbs_without_a_file_take_the_newest_and_print_its_name(
    three: Path, words: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([*words, "--json"]) == 0
    done = capsys.readouterr()
    assert done.err.splitlines()[0] == str(three / f"{NEW}.mcap")
    assert json.loads(done.out)["file"] == str(three / f"{NEW}.mcap")


@pytest.fixture
def running(three: Path) -> Iterator[Path]:
    """The newest recording is still being written."""
    frames = list(run(40))
    mcap(three / f"{NEW}.mcap", frames, closed=False)
    with written(three / f"{NEW}.mcap", three / f"{NEW}.tlog"):
        yield three


@pytest.mark.usefixtures("folder")
@pytest.mark.parametrize(("word", "stem"), [(None, MIDDLE), ("-1", MIDDLE), ("-2", OLD)])
def test_a_recording_that_runs_is_not_chosen(running: Path, word: str | None, stem: str) -> None:
    assert recording_named(word).stem == stem
    assert recording_named(str(running)).stem == MIDDLE


@pytest.mark.usefixtures("folder")
def test_verbs_choose_the_newest_finished_one(
    running: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for words in (["replay", "--plain"], ["explain", "--turns"]):
        assert main([*words, "--json"]) == 0
        assert capsys.readouterr().err.splitlines()[0] == str(running / f"{MIDDLE}.tlog")


@pytest.mark.usefixtures("folder")
@pytest.mark.parametrize("words", [["replay", "--plain"], ["explain", "--turns"]])
def test_a_recording_that_runs_is_read_by_name_and_not_called_damaged(
    running: Path, words: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    file = running / f"{NEW}.mcap"
    assert main([*words, str(file)]) == 0
    said = capsys.readouterr()
    assert said.err == f"{file} is still being recorded: this is the part that is already written\n"
    assert "DAMAGED" not in said.out


@pytest.mark.usefixtures("folder")
def test_nothing_but_a_recording_that_runs_is_reported(folder: Path) -> None:
    only = tlog(folder / f"{NEW}.tlog", list(run(4)))
    with written(only), pytest.raises(UserError, match="is still being recorded, and there is no"):
        recording_named(None)


@pytest.mark.usefixtures("folder")
def test_a_recording_that_runs_is_marked_in_the_list(
    running: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["recordings"]) == 0
    _, *lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines] == ["REC", "-1", "-2"]
    assert main(["recordings", "--json"]) == 0
    rows = json.loads(capsys.readouterr().out)["recordings"]
    assert [row["running"] for row in rows] == [True, False, False]


@pytest.mark.usefixtures("folder")
def test_the_table_of_the_one_before_is_exported(
    three: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["export", "-2", "--out", "t.csv"]) == 0
    assert f"{MIDDLE}.tlog" in capsys.readouterr().err


@pytest.mark.usefixtures("folder")
def test_a_named_file_is_not_announced(three: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["replay", str(three / f"{OLD}.mcap"), "--json"]) == 0
    assert capsys.readouterr().err == ""


@pytest.mark.usefixtures("folder")
def test_explain_prefers_a_robot_that_is_named() -> None:
    for line in (["explain", "--connect", "tcp/127.0.0.1:9"], ["explain"]):
        words = parse(line)
        explain = command_in(words)
        assert isinstance(explain, Explain)
        assert explain.without_robot(parsed(Reach, words)) is None


@pytest.mark.usefixtures("folder")
def test_explain_without_a_robot_takes_the_newest(
    three: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["explain"]) == 0
    said = capsys.readouterr()
    assert "no robot answers at tcp/127.0.0.1:7447: this is the newest recording" in said.err
    assert f"{NEW}.mcap" in said.err
    assert said.out.startswith("at ")


@pytest.mark.usefixtures("folder")
def test_reexecution_takes_the_newest_too(folder: Path) -> None:
    with pytest.raises(UserError, match="there is no recording"):
        study.cli.reexecute.main([])


@pytest.mark.usefixtures("folder")
def test_the_list_shows_what_each_holds(three: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["recordings"]) == 0
    head, *lines = capsys.readouterr().out.splitlines()
    columns = ["BEGAN", "LENGTH", "WORLD", "NAVIGATOR", "LAST", "GOAL", "SIZE", "NAME"]
    assert head.split() == columns
    assert [line.split()[0] for line in lines] == ["-1", "-2", "-3"]
    assert "1.9 s" in lines[0]
    assert "reached" in lines[0]
    assert lines[0].endswith(f"{NEW}.mcap")


@pytest.mark.usefixtures("folder")
def test_json_has_numbers(three: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["recordings", str(three), "--json"]) == 0
    row = json.loads(capsys.readouterr().out)["recordings"][0]
    assert row["length_s"] == pytest.approx(1.95)
    assert (row["robot"], row["outcome"]) == ("r1", "reached")
    size = sum((three / f"{NEW}{suffix}").stat().st_size for suffix in (".mcap", ".tlog"))
    assert row["bytes"] == size


@pytest.mark.usefixtures("folder")
@pytest.mark.parametrize("every", [5, 30, 1000])
def test_an_mcap_alone_has_the_same_summary(folder: Path, every: int) -> None:
    frames = list(run(400))
    both = tlog(folder / f"{OLD}.tlog", frames)
    alone = mcap(folder / f"{NEW}.mcap", frames, every=every, closed=False)
    first, second = summary_of(both), summary_of(alone)
    assert second.length_s == first.length_s
    assert (second.outcome, second.navigator) == (first.outcome, first.navigator)
    assert second.length_s == pytest.approx(19.95)


@pytest.mark.parametrize("suffix", [".mcap", ".tlog"])
def test_end_is_that_of_the_last_status_or_unknown(folder: Path, suffix: str) -> None:
    frames = list(run(400))
    silent = [one for one in frames if not isinstance(one.message, NavigatorStatus)]
    later = [one._replace(time_us=one.time_us + 400 * PERIOD_US) for one in silent * 4]
    make: Callable[..., Path] = tlog if suffix == ".tlog" else partial(mcap, every=300)
    path = make(folder / f"{OLD}{suffix}", [*frames, *later])
    assert summary_of(path).outcome == "reached"
    path.unlink()
    path = make(folder / f"{OLD}{suffix}", silent)
    assert (summary_of(path).outcome, summary_of(path).length_s) == ("", None)


def test_length_goes_on_where_a_new_plant_begins_time_anew(folder: Path) -> None:
    frames: list[PublishedFrame] = []
    since_us = 0
    for ticks in (2_000, 400, 1_000, 40):
        frames += [one._replace(time_us=one.time_us + since_us) for one in run(ticks)]
        since_us += ticks * PERIOD_US
    path = tlog(folder / f"{OLD}.tlog", frames)
    assert summary_of(path).length_s == pytest.approx(since_us / 1e6, abs=0.5)


@pytest.mark.usefixtures("folder")
@pytest.mark.parametrize("text", [b"", b"\x89MCAP", b"garbage" * 100])
def test_a_damaged_file_is_listed_without_facts(folder: Path, text: bytes) -> None:
    for suffix in (".mcap", ".tlog"):
        path = folder / f"{OLD}{suffix}"
        path.write_bytes(text)
        found = summary_of(path)
        assert (found.length_s, found.outcome, found.world) == (None, "", "")
        path.unlink()


@pytest.mark.usefixtures("folder")
def test_a_picture_is_not_a_recording(tmp_path: Path) -> None:
    picture = tmp_path / "run.png"
    picture.write_bytes(b"\x89PNG\r\n\x1a\n" + bytes(range(256)) * 700)
    with pytest.raises(UserError, match=r"run\.png: is not a recording"):
        open_log(picture)


@pytest.mark.usefixtures("folder")
def test_a_recording_of_another_name_is_opened(tmp_path: Path) -> None:
    frames = list(run(4))
    for path in (tlog(tmp_path / "a.bin", frames), mcap(tmp_path / "b.bin", frames)):
        assert sum(1 for _ in open_log(path)) == len(frames)


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


KB = 1000


def recorded(folder: Path, hour: int, size: int, robot: str = "r1") -> Path:
    """Create a recording of that hour: two files, a quarter of the size in the `.tlog`."""
    log = new_log(folder, robot, datetime(2026, 3, 4, hour, tzinfo=UTC))
    log.close()
    log.path.write_bytes(b"t" * (size // 4))
    log.path.with_suffix(".mcap").write_bytes(b"m" * (size - size // 4))
    return log.path


def names_in(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


@each(("text", "size"), [("2GB", 2 * 10**9), ("500 mb", 5 * 10**8), (" 1.5GB ", 15 * 10**8)])
def test_size_is_parsed_with_its_unit(text: str, size: int) -> None:
    assert size_in(text) == size


@each("text", ["", "2", "GB", "-1GB", "0MB", "2TB", "1e3MB", "٣GB!", "nanGB"])
def test_malformed_size_is_rejected(text: str) -> None:
    with pytest.raises(UserError, match="write it as 2GB or 500MB"):
        size_in(text)


def test_size_text_has_a_unit() -> None:
    assert [size_text(size) for size in (0, 1_234_567, 2 * 10**9)] == ["0 MB", "1.23 MB", "2 GB"]


def test_oldest_recordings_are_deleted_and_reported(tmp_path: Path) -> None:
    for hour in range(5):
        recorded(tmp_path, hour, 40 * KB)
    report = Retention(tmp_path, 100 * KB).delete_oldest()
    what = f"deleted the 3 oldest recordings in {tmp_path}, 0.12 MB"
    assert report == f"{what}, to keep within 0.1 MB (--keep)"
    assert [name[9:11] for name in names_in(tmp_path)] == ["03", "03", "04", "04"]
    assert Retention(tmp_path, 100 * KB).delete_oldest() == ""


def test_no_limit_deletes_nothing(tmp_path: Path) -> None:
    recorded(tmp_path, 0, 40 * KB)
    assert Retention(tmp_path, None).delete_oldest() == ""
    assert len(names_in(tmp_path)) == 2


def test_foreign_files_are_kept(tmp_path: Path) -> None:
    foreign = ["flight.tlog", "20260304T000000Z-r1.txt", "notes.mcap", "20260304-r1.tlog"]
    for name in foreign:
        (tmp_path / name).write_bytes(b"x" * 50 * KB)
    recorded(tmp_path, 0, 40 * KB)
    Retention(tmp_path, 1).delete_oldest()
    assert names_in(tmp_path) == sorted(foreign)


def test_file_being_written_is_not_deleted(tmp_path: Path) -> None:
    oldest = recorded(tmp_path, 0, 40 * KB)
    recorded(tmp_path, 1, 40 * KB, "r2")
    newest = new_log(tmp_path, "r1", datetime(2026, 3, 4, 2, tzinfo=UTC))
    newest.append(b"x" * 40 * KB)
    with written(oldest):
        assert "deleted the oldest recording in" in Retention(tmp_path, 50 * KB).delete_oldest()
    assert names_in(tmp_path) == sorted(
        [oldest.name, oldest.with_suffix(".mcap").name, newest.path.name]
    )
    Retention(tmp_path, 50 * KB).delete_oldest()
    assert names_in(tmp_path) == [newest.path.name]
    newest.close()


def test_single_recording_over_the_limit_is_kept(
    tmp_path: Path,
) -> None:
    log = new_log(tmp_path, "r1", datetime(2026, 3, 4, tzinfo=UTC))
    log.append(b"x" * 40 * KB)
    retention = Retention(tmp_path, 10 * KB)
    assert "alone exceeds 0.01 MB (--keep); it is kept" in retention.delete_oldest()
    assert retention.delete_oldest() == ""
    assert names_in(tmp_path) == [log.path.name]
    log.close()


def test_failed_deletion_keeps_all(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    recorded(tmp_path, 0, 40 * KB)

    def refused(_path: Path, **_: object) -> None:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(Path, "unlink", refused)
    assert "deleted" not in Retention(tmp_path, 10 * KB).delete_oldest()
    assert len(names_in(tmp_path)) == 2


def test_warning_estimates_the_remaining_hours(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    total = shutil.disk_usage(tmp_path)
    for free, expected in ((LOW_BYTES, ""), (400 * 10**6, "only 400 MB free in"), (0, "only 0 MB")):
        usage = total._replace(free=free)
        monkeypatch.setattr(shutil, "disk_usage", lambda _, usage=usage: usage)
        warning = Retention(tmp_path, None).warning()
        assert warning.startswith(expected)
        assert bool(warning) == bool(expected)
    assert "enough for about 0.0 h of one robot" in warning


def test_only_the_default_folder_has_a_limit(tmp_path: Path) -> None:
    assert byte_limit(tmp_path, None) is None
    assert byte_limit(tmp_path, "3GB") == 3 * 10**9
    recordings_folder().mkdir(parents=True, exist_ok=True)
    assert byte_limit(recordings_folder(), None) == size_in(DEFAULT_KEEP)
    other = tmp_path / "link"
    os.symlink(recordings_folder(), other)
    assert byte_limit(other, None) == size_in(DEFAULT_KEEP)
