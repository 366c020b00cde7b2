from contextlib import suppress
from math import isclose, pi
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from plant.imports.ros_map import load_ros_map, parse_map_yaml
from plant.model.errors import WorldError
from tests.support.plant.imports.files import P2, P5, YAML, refused


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "hand.pgm").write_bytes(P5)
    (tmp_path / "hand.yaml").write_text(YAML, encoding="utf-8")
    return tmp_path


def yaml(folder: Path, text: str) -> Path:
    path = folder / "other.yaml"
    path.write_text(text, encoding="utf-8")
    return path


def test_unknown_cells_of_a_map_are_blocked(folder: Path) -> None:
    cells = load_ros_map(folder / "hand.yaml")
    assert (cells.columns, cells.rows, cells.cell_m) == (8, 4, 0.5)
    # The picture's first row is the top one; the black frame is left to the outer walls.
    assert cells.blocked[3].tolist() == [False] * 7 + [True]
    assert cells.blocked[1].tolist() == [False] * 3 + [True] * 2 + [False] * 3
    assert cells.blocked.sum() == 3


def test_map_keeps_its_own_frame(folder: Path) -> None:
    cells = load_ros_map(folder / "hand.yaml")
    # The frame was one pixel of 0.5 m wide and its outer corner at (-1, -2).
    assert cells.corner == (-0.5, -1.5)
    assert cells.on_floor((0.0, 0.0)) == (0.5, 1.5)


def test_rotated_map_is_rotated_back(folder: Path) -> None:
    text = YAML.replace("-1.0, -2.0, 0.0", f"-1.0, -2.0, {pi / 2}")
    cells = load_ros_map(yaml(folder, text))
    # Its x axis points up in the frame: the trimmed pixel lies above and to the left.
    x_m, y_m = cells.on_floor((-1.5, -1.5))
    assert isclose(x_m, 0.0, abs_tol=1e-6)
    assert isclose(y_m, 0.0, abs_tol=1e-6)
    assert cells.on_floor((-2.5, 0.5)) == (2.0, 1.0)


def test_text_picture_gives_the_same_map(folder: Path) -> None:
    (folder / "text.pgm").write_bytes(P2)
    cells = load_ros_map(yaml(folder, YAML.replace("hand.pgm", "text.pgm")))
    assert (cells.blocked == load_ros_map(folder / "hand.yaml").blocked).all()


def test_negated_black_is_free(folder: Path) -> None:
    cells = load_ros_map(yaml(folder, YAML.replace("negate: 0", "negate: 1")))
    assert (cells.columns, cells.rows) == (10, 6)
    assert not cells.blocked[0].any()
    assert cells.blocked[1:5, 1:8].sum() == 7 * 4 - 2


def test_threshold_classifies_grey_cells(folder: Path) -> None:
    cells = load_ros_map(yaml(folder, YAML.replace("free_thresh: 0.196", "free_thresh: 0.25")))
    assert cells.blocked.sum() == 2


BAD = [
    ("no image", YAML.replace("image: hand.pgm\n", ""), None, "image", "missing"),
    ("empty image", YAML.replace("hand.pgm", ""), 1, "image", "expected text"),
    ("png", YAML.replace("hand.pgm", "hand.png"), 1, "image", "hand.png is no .pgm file"),
    ("no number", YAML.replace("0.5 ", "half "), 2, "resolution", "'half' is no number"),
    ("zero", YAML.replace("0.5 ", "0 "), 2, "resolution", "out of range"),
    ("nan", YAML.replace("0.5 ", "nan "), 2, "resolution", "out of range"),
    ("list", YAML.replace("0.5 ", "[0.5] "), 2, "resolution", "found a list"),
    ("short origin", YAML.replace(", 0.0]", "]"), 3, "origin", "found 2 values"),
    ("no list", YAML.replace("[-1.0, -2.0, 0.0]", "3"), 3, "origin", "found '3'"),
    ("endless list", YAML.replace("0.0]", "0.0"), 3, "origin", "does not end on its line"),
    ("inf origin", YAML.replace("-1.0", "inf"), 3, "origin", "out of range"),
    ("degrees", YAML.replace("0.0]", "90.0]"), 3, "origin", "a yaw of 90"),
    ("negate", YAML.replace("negate: 0", "negate: maybe"), 4, "negate", "neither 0 nor 1"),
    ("above one", YAML.replace("0.65", "65"), 5, "occupied_thresh", "out of range"),
    ("crossed", YAML.replace("0.196", "0.7"), 6, "free_thresh", "above occupied_thresh"),
    ("misspelt", YAML.replace("free_thresh", "free_tresh"), None, "free_thresh", "missing"),
    ("raw", YAML + "mode: raw\n", 7, "mode", "'raw' is none of trinary, scale"),
    ("nothing free", YAML.replace("0.196", "0.0"), 6, "free_thresh", "no pixel is free"),
    ("twice", YAML + "negate: 1\n", 7, "negate", "given twice"),
    ("nested", YAML + "more:\n  deep: 1\n", 8, "yaml", "cannot read 'deep: 1'"),
    ("no yaml", "hello\n", 1, "yaml", "cannot read 'hello'"),
    ("empty", "", None, "image", "missing"),
]


@pytest.mark.parametrize(("story", "text", "line", "key", "reason"), BAD)
def test_invalid_yaml_is_rejected_with_line_and_key(
    folder: Path, story: str, text: str, line: int | None, key: str, reason: str
) -> None:
    path = yaml(folder, text)
    problem = refused(lambda: load_ros_map(path))
    assert (problem.file, problem.line, problem.key) == (str(path), line, key), story
    assert reason in problem.reason


def test_missing_or_damaged_picture_is_reported_by_name(folder: Path) -> None:
    missing = yaml(folder, YAML.replace("hand.pgm", "gone.pgm"))
    assert refused(lambda: load_ros_map(missing)).file == str(folder / "gone.pgm")
    (folder / "cut.pgm").write_bytes(P5[:-1])
    cut = yaml(folder, YAML.replace("hand.pgm", "cut.pgm"))
    problem = refused(lambda: load_ros_map(cut))
    assert (problem.file, problem.key) == (str(folder / "cut.pgm"), "raster")


def test_yaml_styles_of_map_savers_are_read() -> None:
    text = """\
---
# a comment
image: "my map.pgm"  # said so
origin:
- -1.5
- 2
- 0.0
negate:   0
name: 'it''s' # not
"""
    said = parse_map_yaml(text.replace("name: 'it''s' # not\n", ""), "x")
    assert said.text("image", "") == "my map.pgm"
    assert said.numbers("origin", "", 3, 10.0) == [-1.5, 2.0, 0.0]
    assert said.number("negate", "", 0, 1) == 0.0
    assert (said.line("image"), said.line("origin"), said.line("negate")) == (3, 4, 8)


@settings(max_examples=300)
@given(st.text(alphabet="image: .pgm0\n-[],#'\"reslution\t", max_size=60), st.integers(0, 130))
def test_any_yaml_raises_only_import_errors(noise: str, at: int) -> None:
    for text in (noise, YAML[:at] + noise + YAML[at:]):
        with suppress(WorldError):
            said = parse_map_yaml(text, "x.yaml")
            assert said.text("image", "map.pgm")
            assert 0.0 <= said.number("resolution", "0.05", 0.0, 1.0) <= 1.0
            assert len(said.numbers("origin", "[0, 0, 0]", 3, 1e6)) == 3
