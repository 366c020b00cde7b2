"""`share` puts a recording into one archive, with everything to understand and repeat it."""

import json
from pathlib import Path
from zipfile import ZipFile

import msgspec
import pytest

from ground.cli.main import main
from ground.client.operations.session import NoProgress
from ground.console.parser import read
from ground.reports.share import Drive, Share, changed_parameters
from protocol.topics import DECISION, STATUS
from protocol.wire.enums import GoalState
from tests.support.ground.recording.made import (
    PERIOD_US,
    START_US,
    TopicEncoder,
    decision,
    mcap,
    run,
    status,
    tlog,
)


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    frames = list(run(60))
    turn = msgspec.structs.replace(decision(60 * PERIOD_US * 1000), branch=2)
    frames.append(TopicEncoder().publish(DECISION, turn, START_US + 60 * PERIOD_US))
    tlog(tmp_path / "a.tlog", frames)
    return mcap(tmp_path / "a.mcap", frames)


def test_the_archive_holds_recording_picture_explanation_and_commands(
    recording: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["share", str(recording), "--json"]) == 0
    out = Path(json.loads(capsys.readouterr().out)["out"])
    assert out == recording.with_suffix(".zip")
    with ZipFile(out) as archive:
        assert archive.testzip() is None
        assert sorted(archive.namelist()) == [
            "README.txt",
            "a.mcap",
            "a.tlog",
            "explanation.txt",
            "plot.png",
            "world.json",
        ]
        assert archive.read("a.mcap") == recording.read_bytes()
        assert archive.read("plot.png").startswith(b"\x89PNG")
        assert "virtual" in archive.read("explanation.txt").decode()
        readme = archive.read("README.txt").decode()
    again = "sidestep up --world world.json --navigator vgm --side left --goal 5.4 2 0 --headless"
    assert again in readme
    assert "sidestep rec reexecute a.mcap" in readme
    assert "the seed is not in the recording" in readme


def test_no_control_character_of_a_recording_reaches_the_reader(
    recording: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    hostile = "x\n\x1b]0;OWNED\x07\x9b2J\ud800"

    def drive_of(_: object) -> Drive:
        return Drive({"name": "w"}, ["--noise", hostile], [["param", "set", hostile, "1"]])

    monkeypatch.setattr("ground.reports.share.drive_of", drive_of)
    monkeypatch.setattr("ground.reports.share.explanation", lambda _: hostile)
    assert Share(file=str(recording)).run(NoProgress()).ok
    with ZipFile(recording.with_suffix(".zip")) as archive:
        for name in ("README.txt", "explanation.txt"):
            text = archive.read(name).decode()
            assert "OWNED" in text
            assert text.replace("\n", "").isprintable()


def test_equal_recordings_give_equal_archives(recording: Path, tmp_path: Path) -> None:
    archives = []
    for name in ("one.zip", "two.zip"):
        out = tmp_path / name
        assert Share(file=str(recording), out=str(out)).run(NoProgress()).ok
        archives.append(out.read_bytes())
    assert archives[0] == archives[1]


def test_a_recording_without_a_pose_is_shared_without_a_picture(tmp_path: Path) -> None:
    frame = TopicEncoder().publish(STATUS, status(9, GoalState.NONE), START_US)
    assert Share(file=str(tlog(tmp_path / "a.tlog", [frame]))).run(NoProgress()).ok
    with ZipFile(tmp_path / "a.zip") as archive:
        assert archive.namelist() == ["README.txt", "explanation.txt", "a.tlog"]
        assert "sidestep up" not in archive.read("README.txt").decode()


def test_a_damaged_recording_is_shared_and_called_damaged(
    recording: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    whole = recording.read_bytes()
    recording.write_bytes(whole[: len(whole) // 2])
    assert main(["share", str(recording)]) == 1
    assert "DAMAGED" in capsys.readouterr().out
    with ZipFile(recording.with_suffix(".zip")) as archive:
        assert "DAMAGED" in archive.read("README.txt").decode()


@pytest.mark.parametrize(
    ("words", "why"),
    [
        (["--out", "a.tar"], "end it in .zip"),
        (["--out", "/proc/none/a.zip"], "No such file"),
    ],
)
def test_what_cannot_be_written_is_refused_and_leaves_nothing(
    recording: Path, words: list[str], why: str, capsys: pytest.CaptureFixture[str]
) -> None:
    before = set(recording.parent.iterdir())
    assert main(["share", str(recording), *words]) == 2
    assert why in capsys.readouterr().err
    assert set(recording.parent.iterdir()) == before


def test_parameters_that_were_changed_are_set_again() -> None:
    row = {"name": "d_obs_m", "value": 0.35, "configured": 0.3}
    same = {"name": "radius_m", "value": 0.12, "configured": 0.12}
    assert changed_parameters(json.dumps([row, same])) == [["param", "set", "d_obs_m", "0.35"]]
    assert changed_parameters("no json") == []


def test_share_can_be_typed_in_the_app(recording: Path) -> None:
    operation = read(f"share {recording}")
    assert isinstance(operation, Share)
