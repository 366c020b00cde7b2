"""Verbs without FILE take the newest recording; -2 is the one before."""

import json
import os
from collections.abc import Iterator
from pathlib import Path

import pytest

import study.cli.reexecute
from ground.cli.main import main, parse
from ground.recording.catalogue import began, recording_named, recordings_in
from ground.recording.log_reader import open_log
from ground.recording.summary import summary_of
from ground.user.folders import recordings_folder
from runtime.errors import UserError
from tests.support.ground.recording.made import mcap, run, tlog
from tests.support.ground.recording.recorders import written

OLD, MIDDLE, NEW = (f"20261123T10000{second}Z-r1" for second in (1, 2, 3))


@pytest.fixture(autouse=True)
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


def test_each_recording_is_listed_once_and_the_newest_first(three: Path) -> None:
    names = [path.name for path in recordings_in(three)]
    assert names == [f"{NEW}.mcap", f"{MIDDLE}.tlog", f"{OLD}.mcap"]
    assert recordings_in(three / "missing") == []


def test_folders_below_are_listed_on_request(three: Path) -> None:
    assert recordings_in(three.parent) == []
    assert len(recordings_in(three.parent, below=True)) == 3


def test_a_file_without_a_time_in_its_name_has_that_of_the_file(tmp_path: Path) -> None:
    for name in ("a.tlog", "20269999T999999Z-r1.tlog"):
        (tmp_path / name).touch()
        os.utime(tmp_path / name, (60, 60))
        assert began(tmp_path / name).isoformat() == "1970-01-01T00:01:00+00:00"


@pytest.mark.parametrize(("word", "stem"), [(None, NEW), ("-1", NEW), ("-2", MIDDLE), ("-3", OLD)])
def test_recordings_are_named_from_the_newest(three: Path, word: str | None, stem: str) -> None:
    assert recording_named(word).stem == stem


def test_a_folder_is_its_newest_and_a_file_is_itself(three: Path, tmp_path: Path) -> None:
    assert recording_named(str(three)).stem == NEW
    assert recording_named("drive.mcap") == Path("drive.mcap")
    (tmp_path / "-2").touch()
    assert recording_named("-2") == Path("-2")


def test_what_is_not_there_is_refused_with_the_next_command(folder: Path) -> None:
    with pytest.raises(UserError, match="there is no recording; `sidestep up` makes one"):
        recording_named(None)
    tlog(folder / f"{OLD}.tlog", list(run(4)))
    with pytest.raises(UserError, match="-2: there are only 1 recordings"):
        recording_named("-2")


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


@pytest.mark.parametrize(("word", "stem"), [(None, MIDDLE), ("-1", MIDDLE), ("-2", OLD)])
def test_a_recording_that_runs_is_not_chosen(running: Path, word: str | None, stem: str) -> None:
    assert recording_named(word).stem == stem
    assert recording_named(str(running)).stem == MIDDLE


def test_verbs_choose_the_newest_finished_one(
    running: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for words in (["replay", "--plain"], ["explain", "--turns"]):
        assert main([*words, "--json"]) == 0
        assert capsys.readouterr().err.splitlines()[0] == str(running / f"{MIDDLE}.tlog")


@pytest.mark.parametrize("words", [["replay", "--plain"], ["explain", "--turns"]])
def test_a_recording_that_runs_is_read_by_name_and_not_called_damaged(
    running: Path, words: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    file = running / f"{NEW}.mcap"
    assert main([*words, str(file)]) == 0
    said = capsys.readouterr()
    assert said.err == f"{file} is still being recorded: this is the part that is already written\n"
    assert "DAMAGED" not in said.out


def test_nothing_but_a_recording_that_runs_is_reported(folder: Path) -> None:
    only = tlog(folder / f"{NEW}.tlog", list(run(4)))
    with written(only), pytest.raises(UserError, match="is still being recorded, and there is no"):
        recording_named(None)


def test_a_recording_that_runs_is_marked_in_the_list(
    running: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["recordings"]) == 0
    _, *lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines] == ["REC", "-1", "-2"]
    assert main(["recordings", "--json"]) == 0
    rows = json.loads(capsys.readouterr().out)["recordings"]
    assert [row["running"] for row in rows] == [True, False, False]


def test_the_table_of_the_one_before_is_exported(
    three: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["export", "-2", "--out", "t.csv"]) == 0
    assert f"{MIDDLE}.tlog" in capsys.readouterr().err


def test_a_named_file_is_not_announced(three: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["replay", str(three / f"{OLD}.mcap"), "--json"]) == 0
    assert capsys.readouterr().err == ""


def test_explain_prefers_a_robot_that_is_named() -> None:
    words = parse(["explain", "--connect", "tcp/127.0.0.1:9"])
    assert words.without_robot() is None
    assert parse(["explain"]).without_robot() is None


def test_explain_without_a_robot_takes_the_newest(
    three: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["explain"]) == 0
    said = capsys.readouterr()
    assert "no robot answers at tcp/127.0.0.1:7447: this is the newest recording" in said.err
    assert f"{NEW}.mcap" in said.err
    assert said.out.startswith("at ")


def test_reexecution_takes_the_newest_too(folder: Path) -> None:
    with pytest.raises(UserError, match="there is no recording"):
        study.cli.reexecute.main([])


def test_the_list_shows_what_each_holds(three: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["recordings"]) == 0
    head, *lines = capsys.readouterr().out.splitlines()
    assert head.split() == ["BEGAN", "LENGTH", "WORLD", "NAVIGATOR", "OUTCOME", "SIZE", "NAME"]
    assert [line.split()[0] for line in lines] == ["-1", "-2", "-3"]
    assert "1.9 s" in lines[0]
    assert "reached" in lines[0]
    assert lines[0].endswith(f"{NEW}.mcap")


def test_json_has_numbers(three: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["recordings", str(three), "--json"]) == 0
    row = json.loads(capsys.readouterr().out)["recordings"][0]
    assert row["length_s"] == pytest.approx(1.95)
    assert (row["robot"], row["outcome"]) == ("r1", "reached")
    size = sum((three / f"{NEW}{suffix}").stat().st_size for suffix in (".mcap", ".tlog"))
    assert row["bytes"] == size


@pytest.mark.parametrize("every", [5, 30, 1000])
def test_an_mcap_alone_has_the_same_summary(folder: Path, every: int) -> None:
    frames = list(run(400))
    both = tlog(folder / f"{OLD}.tlog", frames)
    alone = mcap(folder / f"{NEW}.mcap", frames, every=every, closed=False)
    first, second = summary_of(both), summary_of(alone)
    assert second.length_s == first.length_s
    assert (second.outcome, second.navigator) == (first.outcome, first.navigator)
    assert second.length_s == pytest.approx(19.95)


@pytest.mark.parametrize("text", [b"", b"\x89MCAP", b"garbage" * 100])
def test_a_damaged_file_is_listed_without_facts(folder: Path, text: bytes) -> None:
    for suffix in (".mcap", ".tlog"):
        path = folder / f"{OLD}{suffix}"
        path.write_bytes(text)
        found = summary_of(path)
        assert (found.length_s, found.outcome, found.world) == (None, "", "")
        path.unlink()


def test_a_picture_is_not_a_recording(tmp_path: Path) -> None:
    picture = tmp_path / "run.png"
    picture.write_bytes(b"\x89PNG\r\n\x1a\n" + bytes(range(256)) * 700)
    with pytest.raises(UserError, match=r"run\.png: is not a recording"):
        open_log(picture)


def test_a_recording_of_another_name_is_opened(tmp_path: Path) -> None:
    frames = list(run(4))
    for path in (tlog(tmp_path / "a.bin", frames), mcap(tmp_path / "b.bin", frames)):
        assert sum(1 for _ in open_log(path)) == len(frames)
