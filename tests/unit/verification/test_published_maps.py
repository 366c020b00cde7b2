"""Published maps: the cylinders of a Gazebo world, its scale, and a call without maps."""

from pathlib import Path

import pytest

from checks.site import published_maps
from checks.site.published_maps import (
    MapRun,
    MapSet,
    barn_worlds,
    cells,
    cylinders,
    main,
    result,
    table,
    with_table,
)
from protocol.outcome import LOST, UNREACHABLE
from protocol.world import Circle
from study.report.evidence import MapResult, read_evidence
from tests.support.each import each

CYLINDER = """
<model name='unit_cylinder_{n}'>
  <pose frame=''>{x} {y} 0 0 0 0</pose>
  <link name='link'><collision name='collision'><geometry>
    <cylinder><radius>0.075</radius><length>1</length></cylinder>
  </geometry></collision></link>
</model>"""
PLACES = ((-4.0, 0.0), (0.0, 9.5))
EVIDENCE = Path(__file__).resolve().parents[3] / "docs" / "evidence"
RUNS = (
    *[MapRun(True, False, "reached", 0.5)] * 95,
    MapRun(False, True, "collided", 0.0),
    MapRun(False, False, UNREACHABLE, 0.0),
    MapRun(False, False, LOST, 0.0),
    *[MapRun(False, False, "timeout", 0.0)] * 2,
)


def judged(maps: str, noise: str, runs: tuple[MapRun, ...] = RUNS) -> MapResult:
    return result(MapSet(maps, 1.0, ()), noise, runs)


@pytest.fixture
def gazebo(tmp_path: Path) -> Path:
    models = "".join(CYLINDER.format(n=n, x=x, y=y) for n, (x, y) in enumerate(PLACES))
    plane = "<model name='ground_plane'><link name='link'/></model>"
    path = tmp_path / "world_0.world"
    path.write_text(f"<sdf><world name='default'>{plane}{models}</world></sdf>", encoding="utf-8")
    return path


def test_cylinders_are_scaled_and_other_models_left_out(gazebo: Path) -> None:
    assert cylinders(gazebo, 0.5) == "-2.00000,0.00000,0.03750\n0.00000,4.75000,0.03750\n"


def test_world_has_the_cylinders_and_a_way_to_the_goal_behind_them(gazebo: Path) -> None:
    (world,) = barn_worlds(gazebo.parent, 1.0)
    discs = [one for one in world.obstacles if isinstance(one, Circle)]
    assert [one.radius_m for one in discs] == [0.075, 0.075]
    assert world.goal.y_m > max(one.y_m for one in discs)
    assert world.shortest_path_m == pytest.approx(7.1, abs=0.05)


def test_call_without_maps_says_what_to_give(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["--barn", str(tmp_path)]) == 2
    assert "give --barn or --moving-ai" in capsys.readouterr().err


def test_file_that_is_no_xml_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    broken = tmp_path / "world_7.world"
    broken.write_text("<sdf>", encoding="utf-8")
    assert main(["--barn", str(tmp_path)]) == 2
    assert capsys.readouterr().err.startswith(f"{broken}:1: xml: not a Gazebo world: ")


def test_each_trial_is_counted_by_its_end() -> None:
    one = judged("BARN", "default")
    assert (one.trials, one.arrived, one.touched) == (100, 95, 1)
    assert (one.unreachable, one.lost, one.other) == (1, 1, 2)
    assert one.score == pytest.approx(0.475)
    assert one.score_interval.low < 0.475 < one.score_interval.high


@each(
    ("maps", "noise", "verdict"),
    [
        ("Moving AI", "none", ("arrives 100 %", "missed")),
        ("Moving AI", "default", ("arrives ≥ 99 %", "missed")),
        ("Moving AI", "lossy", ("-", "-")),
        ("BARN", "lossy", ("score ≥ 0.48", "missed")),
    ],
)
def test_row_says_what_was_wanted(maps: str, noise: str, verdict: tuple[str, str]) -> None:
    assert cells(judged(maps, noise))[-2:] == verdict
    arrived = judged(maps, noise, RUNS[:90])
    assert cells(arrived)[-1] in ("met", "-")
    assert cells(arrived)[2:4] == ("90 of 90", "100.0 [95.9, 100.0]")


def test_committed_page_has_the_table_of_the_committed_results() -> None:
    found = read_evidence(EVIDENCE).maps
    assert len(found) == 8
    page = (EVIDENCE / "published-maps.md").read_text(encoding="utf-8")
    assert with_table(page, table(found)) == page


def test_page_without_markers_is_refused() -> None:
    with pytest.raises(ValueError, match="add both where the text goes"):
        with_table("# Page", "table")


def test_results_and_page_are_written(
    gazebo: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(published_maps, "SCALES", (0.55,))
    page = tmp_path / "page.md"
    page.write_text("<!-- published-maps:begin -->\nold\n<!-- published-maps:end -->\n")
    files = ["--output", str(tmp_path / "published-maps.json"), "--page", str(page)]
    assert main(["--barn", str(gazebo.parent), "--noise", "none", *files]) == 0
    (one,) = read_evidence(tmp_path).maps
    assert (one.maps, one.scale, one.noise, one.trials, one.arrived) == ("BARN", 0.55, "none", 1, 1)
    assert table([one]) in page.read_text()
    assert "old" not in page.read_text()
    page.write_text("<!-- published-maps:begin --><!-- published-maps:end -->\n")
    assert main(["--results", files[1], "--page", str(page)]) == 0
    assert table([one]) in page.read_text()
