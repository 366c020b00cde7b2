"""`sidestep worlds generate` and `sidestep worlds import`."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from plant.cli import main, write
from plant.corpus import FAMILIES, generate
from plant.model.geometry import clearance_m
from plant.shortest_path import shortest_path_m
from plant.world.file import load
from tests.support.each import each
from tests.support.plant import MAP, P5, SCEN, YAML

Told = pytest.CaptureFixture[str]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "hand.map").write_text(MAP, encoding="utf-8")
    (tmp_path / "hand.map.scen").write_text(SCEN, encoding="utf-8")
    (tmp_path / "hand.yaml").write_text(YAML, encoding="utf-8")
    (tmp_path / "hand.pgm").write_bytes(P5)
    np.save(tmp_path / "grid_7.npy", np.eye(20, dtype=np.int64))
    (tmp_path / "list.csv").write_text("x,y\n1,1\n2,1.5\n3,0.5,0.2\n", encoding="utf-8")
    return tmp_path


def made(folder: Path, *argv: str) -> list[Path]:
    """Return the files that an import writes."""
    out = folder / "out"
    assert main(["import", *argv, "--out", str(out)]) == 0
    return sorted(out.glob("*.toml"))


def refusal(capsys: Told, *argv: str) -> str:
    assert main([*argv]) == 2
    told = capsys.readouterr()
    assert told.out == ""
    return told.err


def test_a_file_with_another_world_is_only_replaced_by_force(folder: Path, capsys: Told) -> None:
    """Maps of two places have the same name, as `map.yaml` of ROS has everywhere."""
    first, out = str(folder / "hand.yaml"), folder / "out"
    (path,) = made(folder, first)
    assert made(folder, first) == [path], "the same world may be written again"
    text = path.read_text()
    other = text.replace('name = "', 'name = "other_', 1)
    path.write_text(other)
    capsys.readouterr()
    words = ["import", first, "--out", str(out)]
    assert "another world is there" in refusal(capsys, *words)
    assert path.read_text() == other
    assert main([*words, "--force"]) == 0
    assert path.read_text() == text


def test_generate_writes_the_requested_worlds(tmp_path: Path, capsys: Told) -> None:
    out = tmp_path / "new" / "folder"
    argv = ["generate", "--family", "box", "u_trap", "box", "--per-family", "3", "--seed", "4"]
    assert main([*argv, "--out", str(out)]) == 0
    assert capsys.readouterr().out == f"6 worlds in {out}\n"
    assert len(list(out.iterdir())) == 6
    assert load(out / "box_4_002.toml") == generate("box", 2, 4)
    assert (out / "box_4_002.toml").read_text().startswith("# Number 2 of the family box from seed")


def test_generate_makes_every_family_but_grids_by_default(tmp_path: Path) -> None:
    assert main(["generate", "--per-family", "1", "--out", str(tmp_path)]) == 0
    found = {load(path).family for path in tmp_path.glob("*.toml")}
    assert found == set(FAMILIES)
    assert (
        main(["generate", "--family", "grid_maze", "--per-family", "1", "--out", str(tmp_path)])
        == 0
    )
    assert load(tmp_path / "grid_maze_1_000.toml").family == "grid_maze"


@pytest.mark.parametrize(
    ("argv", "says"),
    [
        (["--family", "u_tarp"], "invalid choice: 'u_tarp'"),
        (["--per-family", "0"], "0 is not within 1 to"),
        (["--per-family", "x"], "not a whole number"),
        (["--seed", "-1"], "-1 is not within 0 to"),
    ],
)
def test_generate_rejects_impossible_requests(
    argv: list[str], says: str, tmp_path: Path, capsys: Told
) -> None:
    told = refusal(capsys, "generate", *argv, "--out", str(tmp_path))
    assert "sidestep worlds generate: error:" in told
    assert says in told


def test_unwritable_output_directory_is_reported(tmp_path: Path, capsys: Told) -> None:
    (tmp_path / "file").write_text("x")
    told = refusal(capsys, "generate", "--family", "open", "--out", str(tmp_path / "file"))
    reason = "File exists; fix: give a directory that can be written to"
    assert told == f"{tmp_path / 'file'}: --out: {reason}\n"


@each("name", ["../escaped", "/tmp/escaped", "..", "a/b", "a\0b", ""])
def test_world_name_cannot_leave_the_directory(name: str, tmp_path: Path, capsys: Told) -> None:
    out = tmp_path / "out"
    world = replace(load("box"), name=name)
    assert write([(world, "")], out) == 2
    assert f"{out}: name: {name!r} is not a valid name" in capsys.readouterr().err
    assert list(tmp_path.rglob("*")) == []


def test_unusual_file_name_gives_a_readable_world(folder: Path) -> None:
    """Name the file in the comment of the world, control characters included."""
    odd = folder / ".b\x1b\nname = 3\u2028.map"
    (folder / "hand.map").rename(odd)
    (file,) = made(folder, str(odd))
    assert file.name == "_b__name___3__1_000.toml"
    assert load(str(file)).name == file.stem


def test_moving_ai_map_becomes_a_world(folder: Path) -> None:
    (path,) = made(folder, str(folder / "hand.map"))
    world = load(path)
    assert (world.name, world.family, world.family_seed) == ("hand_1_000", "moving_ai", 1)
    assert world.size_m == (3.2, 2.0)
    assert world.reachable
    exact_m = shortest_path_m(world)
    assert exact_m == pytest.approx(world.shortest_path_m, abs=0.01)
    assert path.read_text().startswith("# Made of hand.map with seed 1.\n")


def test_seed_selects_places_and_count_limits_them(folder: Path) -> None:
    paths = made(folder, str(folder / "hand.map"), "--count", "4", "--seed", "3", "--cell", "0.5")
    worlds = [load(path) for path in paths]
    assert [world.name for world in worlds] == [f"hand_3_{index:03d}" for index in range(4)]
    assert {world.size_m for world in worlds} == {(4.0, 2.5)}
    assert len({world.start for world in worlds}) > 1
    before = [path.read_text() for path in paths]
    assert [
        path.read_text()
        for path in made(
            folder, str(folder / "hand.map"), "--count", "4", "--seed", "3", "--cell", "0.5"
        )
    ] == before


def test_window_is_a_part_of_the_map(folder: Path) -> None:
    rows = "\n".join("." * 60 for _ in range(60))
    (folder / "big.map").write_text(f"type octile\nheight 60\nwidth 60\nmap\n{rows}\n")
    (path,) = made(folder, str(folder / "big.map"), "--window", "12")
    assert load(path).size_m == pytest.approx((4.8, 4.8))


def test_scenarios_define_start_and_goal(folder: Path) -> None:
    paths = made(folder, str(folder / "hand.map.scen"), "--count", "2")
    first, second = (load(path) for path in paths)
    assert (first.name, second.name) == ("hand_1_002", "hand_1_003")
    # Cell (0, 0) is the upper left one.
    assert (first.start.x_m, first.start.y_m) == pytest.approx((0.2, 1.8))
    assert (first.goal.x_m, first.goal.y_m) == pytest.approx((3.0, 0.2))


def test_ros_map_becomes_a_world_in_its_own_frame(folder: Path) -> None:
    argv = [str(folder / "hand.yaml"), "--start", "0", "-1", "--goal", "3", "-1.25"]
    (path,) = made(folder, *argv)
    world = load(path)
    assert (world.name, world.family, world.size_m) == ("hand", "ros_map", (4.0, 2.0))
    assert (world.start.x_m, world.start.y_m) == (0.5, 0.5)
    assert (world.goal.x_m, world.goal.y_m) == (3.5, 0.25)


@each(
    ("start", "why"),
    [
        (("-9", "0"), "--start: (-9, 0) is outside of the map"),
    ],
)
def test_wrong_start_is_named_in_the_frame_of_the_map(
    start: tuple[str, str], why: str, folder: Path, capsys: Told
) -> None:
    argv = ["--start", *start, "--goal", "3", "-1.25", "--out", str(folder / "out")]
    told = refusal(capsys, "import", str(folder / "hand.yaml"), *argv)
    assert told.startswith(f"{folder / 'hand.yaml'}: {why}; fix: choose a free place")


def test_barn_grid_is_crossed_from_front_to_back(folder: Path) -> None:
    (path,) = made(folder, str(folder / "grid_7.npy"))
    world = load(path)
    assert (world.name, world.family, len(world.obstacles)) == ("grid_7", "barn", 20)
    assert (world.start.x_m, world.goal.x_m) == (0.75, 5.25)
    # Twenty cylinders in a diagonal from wall to wall that touch one another's corners.
    assert world.reachable is False


def test_cylinder_list_becomes_a_world(folder: Path) -> None:
    (path,) = made(folder, str(folder / "list.csv"))
    world = load(path)
    start = (world.start.x_m, world.start.y_m)
    assert world.family == "cylinders"
    assert all(clearance_m(start, one) >= 0.17 for one in world.obstacles)
    assert world.shortest_path_m == pytest.approx(shortest_path_m(world), abs=1e-3)


def test_cylinder_list_uses_its_own_frame(folder: Path) -> None:
    (path,) = made(folder, str(folder / "list.csv"), "--start", "0.5", "1", "--goal", "3.5", "1")
    world = load(path)
    assert world.goal.x_m - world.start.x_m == pytest.approx(3.0)
    assert world.start.x_m == pytest.approx(0.5 - (1 - 0.075 - 1.0))


@each(
    ("argv", "says"),
    [
        (["gone.map"], "gone.map: file: cannot be read: No such file or directory; fix: "),
        (["hand"], "no importer for a file without suffix"),
        (["."], "bag: metadata.yaml is missing; fix: `ros2 bag reindex`"),
        (["hand.pgm"], "hand.pgm: file: no importer for .pgm; there are .map, "),
        (["hand.map", "--start", "1", "1"], "hand.map: --start: start and goal go together"),
        (
            ["hand.map", "--start", "1", "1", "--goal", "2", "1", "--count", "2"],
            "hand.map: --start: with --count or --window it is chosen",
        ),
        (["hand.yaml", "--cell", "0.1"], "hand.yaml: --cell: not for a .yaml file"),
        (["grid_7.npy", "--count", "2"], "grid_7.npy: --count: not for a .npy file"),
        (["hand.map.scen", "--count", "3"], "--count: 3 asked for, 2 in the file"),
        (["hand.map", "--cell", "0.05"], "hand.map: size: 0.4 x 0.25 m, a side must be 0.5"),
        (["hand.map", "--cell", "0.2"], "hand.map: start: no two places 0.17 m from anything"),
        (
            ["hand.map", "--start", "0.2", "0.2", "--goal", "1.0", "1.4"],
            "hand.map: --goal: (1, 1.4) is in an obstacle",
        ),
        (
            ["hand.yaml", "--start", "0", "-1", "--goal", "30", "1"],
            "hand.yaml: --goal: (30, 1) is outside of the map",
        ),
    ],
)
def test_import_error_names_file_key_and_remedy(
    argv: list[str], says: str, folder: Path, capsys: Told
) -> None:
    told = refusal(capsys, "import", str(folder / argv[0]), *argv[1:], "--out", str(folder / "o"))
    assert says in told
    assert "; fix: " in told
    assert not (folder / "o").exists()


@pytest.mark.parametrize(
    "argv", [["--cell", "0"], ["--cell", "nan"], ["--start", "inf", "0"], ["--count", "0"]]
)
def test_impossible_numbers_are_usage_errors(argv: list[str], folder: Path, capsys: Told) -> None:
    told = refusal(capsys, "import", str(folder / "hand.map"), *argv, "--out", str(folder))
    assert "usage: sidestep worlds import" in told


def test_scenario_without_its_map_is_reported(folder: Path, capsys: Told) -> None:
    (folder / "hand.map").unlink()
    told = refusal(capsys, "import", str(folder / "hand.map.scen"), "--out", str(folder / "o"))
    assert ": map: hand.map is not beside it; fix: put hand.map beside it" in told


def test_blocked_map_has_no_free_place(folder: Path, capsys: Told) -> None:
    (folder / "full.map").write_text("type octile\nheight 3\nwidth 3\nmap\n" + "@@@\n" * 3)
    told = refusal(capsys, "import", str(folder / "full.map"), "--out", str(folder / "o"))
    assert "start: no two places" in told
