"""`plot`, `export` and `share`: what they make of a recording, and why they cannot."""

import builtins
import csv
import io
import json
import xml.etree.ElementTree as ElementTree
from collections.abc import Mapping, Sequence
from math import isnan
from pathlib import Path
from typing import Any
from zipfile import ZipFile

import matplotlib.image
import msgspec
import pyarrow.parquet
import pytest

from ground.cli.main import main
from ground.client.outcomes import NoProgress
from ground.commands.plot import Plot
from ground.commands.share import DrivenRun, Share, changed_parameters
from ground.console.parser import read
from ground.missions.mission import Polygon
from ground.missions.transfer import fence_items_of
from ground.recording.log_reader import open_log
from ground.recording.tables import TimeAxis, collect_series
from protocol.topics import ANSWERED, COMMANDED, DECISION, SONAR, STATUS
from protocol.wire.enums import GoalState, MissionType
from protocol.wire.message import Message
from protocol.wire.messages import MissionCount, MissionVerdict
from protocol.world import run_in
from tests.support.each import each
from tests.support.ground.made_recordings import (
    PERIOD_US,
    START_US,
    PublishedFrame,
    TopicEncoder,
    decision,
    mcap,
    run,
    scan,
    status,
    tlog,
)
from tests.support.ground.station import WORLD_TEXT


@pytest.fixture
def exported_frames() -> list[PublishedFrame]:
    return list(run(20))


@pytest.fixture
def log(tmp_path: Path, exported_frames: list[PublishedFrame]) -> str:
    return str(mcap(tmp_path / "a.mcap", exported_frames))


def rows_of(text: str) -> list[list[str]]:
    return list(csv.reader(io.StringIO(text)))


def test_both_files_of_a_run_give_the_same_table(
    tmp_path: Path,
    exported_frames: list[PublishedFrame],
    log: str,
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(["export", log]) == 0
    from_mcap = capsys.readouterr().out
    assert main(["export", str(tlog(tmp_path / "a.tlog", exported_frames))]) == 0
    assert capsys.readouterr().out == from_mcap
    assert from_mcap.startswith("time_s,utc_s,topic,message,field,value\n")


def test_wide_csv_comes_back_as_it_was(tmp_path: Path, log: str) -> None:
    out = tmp_path / "wide.csv"
    words = ["--shape", "wide", "--rate", "10", "--from", "0.2", "--to", "0.6", "--out", str(out)]
    assert main(["export", log, *words]) == 0
    head, *rows = rows_of(out.read_text())
    assert [row[0] for row in rows] == [f"0.{n}00000" for n in range(2, 7)]
    assert {len(row) for row in rows} == {len(head)}
    x_m = head.index("tlm/odometry.x_m")
    assert [row[x_m] for row in rows] == ["0.6", "0.6", "0.6", "0.6", "0.625"]


@pytest.mark.parametrize("shape", ["long", "wide"])
def test_parquet_holds_what_the_csv_holds(tmp_path: Path, log: str, shape: str) -> None:
    text, table = tmp_path / "a.csv", tmp_path / "a.parquet"
    assert main(["export", log, "--shape", shape, "--out", str(text)]) == 0
    words = ["--shape", shape, "--format", "parquet", "--out", str(table)]
    assert main(["export", log, *words]) == 0
    head, *rows = rows_of(text.read_text())
    found = pyarrow.parquet.read_table(table).to_pylist()
    assert len(found) == len(rows)
    for row, values in zip(rows, found, strict=True):
        assert list(values) == head
        assert all(map(same, row, values.values()))


def same(text: str, value: object) -> bool:
    if value is None:
        return text == ""
    if isinstance(value, float):
        return float(text) == value or (isnan(value) and text == "nan")
    return text == str(value)


def test_a_damaged_file_gives_what_is_left_and_ends_with_1(
    tmp_path: Path, log: str, capsys: pytest.CaptureFixture[str]
) -> None:
    whole = Path(log).read_bytes()
    Path(log).write_bytes(whole[: len(whole) // 3])
    assert main(["export", log, "--out", str(tmp_path / "t.csv"), "--json"]) == 1
    printed = json.loads(capsys.readouterr().out)
    assert printed["rows"] > 0
    assert printed["lost_bytes"] > 0
    assert "skipped" in printed["damage"]


@each(
    ("words", "why"),
    [
        (["--format", "parquet"], "add --out"),
        (["--json"], "add --out"),
        (["--rate", "10"], "needs --shape wide"),
        (["--shape", "wide", "--rate", "0"], "out of range"),
        (["--shape", "wide", "--rate", "1e9"], "out of range"),
        (["--from", "3", "--to", "2"], "is after"),
        (["--out", "/proc/none/a.csv"], "No such file"),
    ],
)
def test_what_does_not_go_together_is_refused_with_the_reason(
    log: str, words: list[str], why: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["export", log, *words]) == 2
    assert why in capsys.readouterr().err


@pytest.mark.parametrize("linked", [False, True])
def test_a_recording_is_not_overwritten_by_its_table(
    tmp_path: Path, log: str, linked: bool, capsys: pytest.CaptureFixture[str]
) -> None:
    out, before = Path(log), Path(log).read_bytes()
    if linked:
        out = tmp_path / "table.csv"
        out.symlink_to(log)
    assert main(["export", log, "--out", str(out)]) == 2
    assert "is the recording itself" in capsys.readouterr().err
    assert Path(log).read_bytes() == before


def test_missing_pyarrow_names_the_package(
    log: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    real_import = builtins.__import__

    def without(
        name: str,
        globals_: Mapping[str, object] | None = None,
        locals_: Mapping[str, object] | None = None,
        fromlist: Sequence[str] = (),
        level: int = 0,
    ) -> Any:
        if name.startswith("pyarrow"):
            raise ImportError(name)
        return real_import(name, globals_, locals_, fromlist, level)

    monkeypatch.setattr(builtins, "__import__", without)
    assert main(["export", log, "--format", "parquet", "--out", "x.parquet"]) == 2
    assert "pip install 'sidestep[study]'" in capsys.readouterr().err


def test_a_file_that_is_not_there_is_named(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["export", "nowhere.tlog"]) == 2
    assert "nowhere.tlog: No such file" in capsys.readouterr().err


def test_empty_recording_is_an_error(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    empty = tmp_path / "empty.tlog"
    empty.touch()
    assert main(["export", str(empty)]) == 1
    assert (
        "0 frames, 0 rows: the recording is empty; `sidestep rec list`" in capsys.readouterr().err
    )


@pytest.fixture
def frames() -> list[PublishedFrame]:
    return list(run(60))


def test_a_png_has_the_drawing_in_it(
    tmp_path: Path, frames: list[PublishedFrame], capsys: pytest.CaptureFixture[str]
) -> None:
    log = mcap(tmp_path / "a.mcap", frames)
    assert main(["plot", str(log), "--json"]) == 0
    printed = json.loads(capsys.readouterr().out)
    image = matplotlib.image.imread(printed["out"])
    assert printed["out"].endswith("a.png")
    assert image.shape[:2] == (900, 1440)
    assert len({tuple(pixel) for row in image[::7, ::7] for pixel in row}) > 20, "not blank"


def drawn_twice(tmp_path: Path, frames: list[PublishedFrame], suffix: str, style: str) -> bytes:
    """Return a figure; two of the same run must be equal."""
    log = str(mcap(tmp_path / "a.mcap", frames))
    drawn = []
    for number in range(2):
        out = tmp_path / f"{number}{suffix}"
        assert main(["plot", log, "--style", style, "--out", str(out)]) == 0
        drawn.append(out.read_bytes())
    assert drawn[0] == drawn[1]
    return drawn[0]


def test_an_svg_is_well_formed_and_names_what_it_shows(
    tmp_path: Path, frames: list[PublishedFrame]
) -> None:
    text = drawn_twice(tmp_path, frames, ".svg", "screen").decode()
    ElementTree.fromstring(text)
    for words in (
        "r1 in made: REACHED at",
        "goal accepted",
        "end of a goal",
        "speed (m/s)",
        "turning (rad/s)",
        "true path",
        "estimated path",
        "nearest echo",
        "estimated (1 sigma)",
    ):
        assert f"<!-- {words}" in text, words


def test_the_figure_of_a_paper_is_one_column_wide_without_a_title(
    tmp_path: Path, frames: list[PublishedFrame]
) -> None:
    pdf = drawn_twice(tmp_path, frames, ".pdf", "paper").decode("latin-1")
    assert pdf.startswith("%PDF")
    assert "/MediaBox [ 0 0 252 " in pdf, "3.5 inches"
    out = tmp_path / "a.svg"
    assert main(["plot", str(tmp_path / "a.mcap"), "--style", "paper", "--out", str(out)]) == 0
    svg = out.read_text()
    assert 'width="252pt"' in svg
    assert "r1 in made" not in svg
    assert "x (m)" in svg


def test_the_fence_is_drawn_and_several_goals_are_numbered(
    tmp_path: Path, frames: list[PublishedFrame]
) -> None:
    encoder = TopicEncoder()
    fence = fence_items_of(Polygon(corners=((0.0, 0.0), (5.0, 0.0), (5.0, 3.0))))
    count = MissionCount(count=len(fence), mission_type=MissionType.FENCE)
    verdict = MissionVerdict(mission_id=1, item=65_535, reason=0, mission_type=MissionType.FENCE)
    uploads: list[Message] = [count, *fence]
    added = [encoder.publish(COMMANDED, one, START_US + 1) for one in uploads]
    added.append(encoder.publish(ANSWERED, verdict, START_US + 2))
    other = msgspec.structs.replace(status(70_000_000_000), goal_x_m=1.0)
    added.append(encoder.publish(STATUS, other, START_US + 3))
    out = tmp_path / "a.svg"
    assert main(["plot", str(mcap(tmp_path / "a.mcap", [*frames, *added])), "--out", str(out)]) == 0
    text = out.read_text()
    assert "<!-- fence -->" in text
    assert "<!-- 1 -->" in text
    assert "<!-- 2 -->" in text


def test_of_very_many_echoes_a_part_is_drawn(
    tmp_path: Path, frames: list[PublishedFrame], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Keep pictures of two hours small enough to open."""
    log, drawn = mcap(tmp_path / "a.mcap", frames), []
    for most in (4000, 10):
        monkeypatch.setattr("ground.recording.figure.MAX_ECHOES", most)
        out = tmp_path / f"{most}.svg"
        assert main(["plot", str(log), "--out", str(out)]) == 0
        drawn.append(out.read_text().count("<use "))
    assert 60 < drawn[0] - drawn[1] < 120, "two echoes a tick, or hardly any"


def test_tlog_is_drawn_without_a_world_or_with_a_named_one(
    tmp_path: Path, frames: list[PublishedFrame], capsys: pytest.CaptureFixture[str]
) -> None:
    log = str(tlog(tmp_path / "a.tlog", frames))
    assert main(["plot", log]) == 0
    assert "add it with --world W" in capsys.readouterr().out
    assert main(["plot", log, "--world", "box", "--out", str(tmp_path / "b.svg")]) == 0
    assert "r1 in box" in (tmp_path / "b.svg").read_text()
    assert main(["plot", log, "--world", "no_such_world"]) == 2


def test_a_damaged_file_is_drawn_as_far_as_it_goes(
    tmp_path: Path, frames: list[PublishedFrame], capsys: pytest.CaptureFixture[str]
) -> None:
    log = mcap(tmp_path / "a.mcap", frames)
    whole = log.read_bytes()
    log.write_bytes(whole[: len(whole) // 2])
    assert main(["plot", str(log)]) == 1
    assert "DAMAGED" in capsys.readouterr().out


def test_it_can_be_asked_for_in_the_app(tmp_path: Path, frames: list[PublishedFrame]) -> None:
    operation = read(f"plot {mcap(tmp_path / 'a.mcap', frames)}")
    assert isinstance(operation, Plot)
    assert operation.run(NoProgress()).ok
    assert (tmp_path / "a.png").exists()


@pytest.mark.parametrize(
    ("words", "why"),
    [
        (["--out", "a.gif"], "end it in .png, .svg or .pdf"),
        (["--from", "1e6"], "no pose in that time"),
        (["--out", "/proc/none/a.png"], "No such file"),
    ],
)
def test_what_cannot_be_drawn_is_refused_with_the_reason(
    tmp_path: Path,
    frames: list[PublishedFrame],
    words: list[str],
    why: str,
    capsys: pytest.CaptureFixture[str],
) -> None:
    log = str(mcap(tmp_path / "a.mcap", frames))
    assert main(["plot", log, *words]) == 2
    assert why in capsys.readouterr().err


def test_what_is_no_recording_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "a.tlog"
    path.write_bytes(b"not a log")
    assert main(["plot", str(path)]) == 2
    assert "has no frame (DAMAGED: 9 bytes" in capsys.readouterr().err


def test_the_error_is_against_the_truth_of_the_same_stamp(
    tmp_path: Path, frames: list[PublishedFrame]
) -> None:
    found = collect_series(TimeAxis(open_log(tlog(tmp_path / "a.tlog", frames))), 0.15)
    assert len(found.error_m.values) == len(found.estimated) == 60
    assert found.error_m.values == pytest.approx([0.01] * 60, abs=1e-5)
    assert found.sigma_m.values[0] == pytest.approx(0.0005**0.5, abs=1e-6)
    assert [mark.kind for mark in found.marks] == ["goal", "outcome"]


def test_no_echo_is_a_gap_and_no_distance(tmp_path: Path) -> None:
    encoder = TopicEncoder()
    frames = [encoder.publish(SONAR, scan(n, n, echo=n % 2), START_US + n) for n in range(4)]
    frames.append(encoder.publish(STATUS, status(9), START_US + 9))
    found = collect_series(TimeAxis(open_log(tlog(tmp_path / "a.tlog", frames))), 0.15)
    assert [isnan(value) for value in found.nearest_m.values] == [True, False, True, False]
    assert found.echoes == [], "without a pose an echo has no place"
    assert [round(goal[0], 3) for goal in found.goals] == [5.4]


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

    def drive_of(_: object) -> DrivenRun:
        return DrivenRun(run_in(WORLD_TEXT), ["--noise", hostile], [["param", "set", hostile, "1"]])

    monkeypatch.setattr("ground.commands.share.drive_of", drive_of)
    monkeypatch.setattr("ground.commands.share.explanation", lambda _: hostile)
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
