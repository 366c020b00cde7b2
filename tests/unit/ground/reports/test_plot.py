"""`plot` draws a run with its world, or names the reason why it cannot."""

import json
import xml.etree.ElementTree as ElementTree
from math import isnan
from pathlib import Path

import matplotlib.image
import msgspec
import pytest

from ground.cli.main import main
from ground.client.operations.session import NoProgress
from ground.console.parser import read
from ground.missions.mission import Polygon
from ground.missions.transfer import fence_items_of
from ground.recording.log_reader import open_log
from ground.recording.tables import TimeAxis, collect_series
from ground.reports.plot import Plot
from protocol.topics import ANSWERED, COMMANDED, SONAR, STATUS
from protocol.wire.enums import MissionType
from protocol.wire.message import Message
from protocol.wire.messages import MissionCount, MissionVerdict
from tests.support.ground.recording.made import (
    START_US,
    PublishedFrame,
    TopicEncoder,
    mcap,
    run,
    scan,
    status,
    tlog,
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
        monkeypatch.setattr("ground.reports.figure.MAX_ECHOES", most)
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
