"""Maps of other projects: BARN, MovingAI, Netpbm and ROS."""

import io
from contextlib import suppress
from math import isclose, pi
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from plant.imports.barn import BEFORE_M, CylinderField, load_grid, load_list, parse_list
from plant.imports.cells import Cells
from plant.imports.moving_ai import MAX_CELLS, MovingAiScenario, fits, parse_map, parse_scenarios
from plant.imports.ros_map import load_ros_map, parse_map_yaml, parse_pgm
from plant.model.errors import WorldError
from tests.support.each import each
from tests.support.plant import MAP, P2, P5, ROWS, SCEN, YAML, refused


def cells(text: str = MAP) -> Cells:
    return parse_map(text, "hand.map", 0.4)


def test_map_has_its_first_row_at_the_top() -> None:
    found = cells()
    assert (found.columns, found.rows, found.cell_m) == (8, 5, 0.4)
    assert found.size_m == (3.2, 2.0)
    assert not found.blocked[4].any()
    assert found.blocked[3].tolist() == [False] + 5 * [True] + 2 * [False]
    assert found.blocked[2, 1]
    assert found.blocked[2, 6]


def test_only_dot_g_and_s_cells_are_free() -> None:
    row = cells("type octile\nheight 1\nwidth 7\nmap\n.GS@OTW\n").blocked[0]
    assert row.tolist() == [False] * 3 + [True] * 4


@each(
    "text",
    [
        MAP.rstrip("\n"),
        MAP + "\n\n",
        MAP.replace("height 5\nwidth 8", "width 8\nheight 5"),
        MAP.replace("\n.", "\n.", 1).replace("....\n", "....  \n"),
    ],
)
def test_tolerated_format_variations_give_the_same_map(text: str) -> None:
    assert (cells(text).blocked == cells().blocked).all()


BAD_MAPS = [
    ("empty", "", 1, "type", "expected type octile"),
    ("another type", MAP.replace("octile", "tile"), 1, "type", "found 'type tile'"),
    ("no height", MAP.replace("height 5", "hight 5"), 2, "height", "found 'hight 5'"),
    ("height zero", MAP.replace("height 5", "height 0"), 2, "height", "found 'height 0'"),
    ("height no number", MAP.replace("height 5", "height five"), 2, "height", "five"),
    ("width huge", MAP.replace("width 8", f"width {MAX_CELLS + 1}"), 3, "width", "4097"),
    ("width twice", MAP.replace("height 5", "width 8"), 3, "width", "found 'width 8'"),
    ("cut header", "type octile\nheight 5", 3, "width", "found ''"),
    ("no map", MAP.replace("map\n", ""), 4, "map", "missing"),
    ("unknown terrain", MAP.replace("GS", "GX"), 8, "map", "'X' in column 5 is no terrain"),
    ("a row too short", MAP.replace(".@@@@T..", ".@@@@T."), 6, "map", "7 cells in this row"),
    ("a row too long", MAP.replace(".@@@@T..", ".@@@@T..."), 6, "map", "9 cells in this row"),
    ("cut", MAP[: -len("........\n")], None, "map", "4 rows of cells, but height is 5"),
    ("a row too many", MAP + "........\n", None, "map", "6 rows of cells, but height is 5"),
]


@each(("story", "text", "line", "key", "reason"), BAD_MAPS)
def test_invalid_map_is_rejected_with_line_and_key(
    story: str, text: str, line: int | None, key: str, reason: str
) -> None:
    problem = refused(lambda: cells(text))
    assert (problem.file, problem.line, problem.key) == ("hand.map", line, key), story
    assert reason in problem.reason


@settings(max_examples=300)
@given(st.text(alphabet="typeoctilheghwdmap 0123458\n.@GSTWOx", max_size=80), st.integers(0, 60))
def test_any_map_text_raises_only_import_errors(noise: str, at: int) -> None:
    for text in (noise, MAP[:at] + noise, MAP[:at] + noise + MAP[at:]):
        try:
            found = cells(text)
        except WorldError:
            continue
        assert found.blocked.shape == (found.rows, found.columns)


def test_scenarios_give_start_and_goal_by_column_and_row() -> None:
    first, second = parse_scenarios(SCEN, "hand.map.scen")
    assert first == MovingAiScenario(2, "maps/hand.map", 8, 5, (0, 0), (7, 4))
    assert (second.line, second.start, second.goal) == (3, (3, 3), (0, 4))
    assert parse_scenarios(SCEN.replace("version 1", "version 1.0"), "x") == [first, second]
    assert parse_scenarios(SCEN.replace("\t", " "), "x") == [first, second]


@each(
    ("text", "line", "key", "reason"),
    [
        ("", 1, "version", "expected version 1"),
        ("version 2\n", 1, "version", "found 'version 2'"),
        ("version 1\n\n", 1, "scenario", "none in the file"),
        (SCEN.replace("\t7\t", "\t-7\t"), 2, "scenario", "whole numbers"),
        (SCEN.replace("\t7\t4\t9.0", "\t7\t4"), 2, "scenario", "9 fields"),
        (SCEN[:-8], 3, "scenario", "9 fields"),
    ],
)
def test_invalid_scenarios_are_rejected(text: str, line: int, key: str, reason: str) -> None:
    problem = refused(lambda: parse_scenarios(text, "hand.scen"))
    assert (problem.line, problem.key) == (line, key)
    assert reason in problem.reason


@each(
    ("change", "key", "reason"),
    [
        ({"width": 9}, "map", "made for 9 x 5 cells, the map has 8 x 5"),
        ({"start": (8, 0)}, "start", "(8, 0) is outside the map"),
        ({"goal": (0, 5)}, "goal", "(0, 5) is outside the map"),
        ({"goal": (1, 1)}, "goal", "(1, 1) is on a blocked cell"),
    ],
)
def test_scenario_that_does_not_fit_its_map_is_rejected(
    change: dict[str, object], key: str, reason: str
) -> None:
    scenario = parse_scenarios(SCEN, "x")[0]._replace(**change)  # type: ignore[arg-type]
    problem = refused(lambda: fits(scenario, cells(), "hand.scen"))
    assert (problem.line, problem.key, problem.reason) == (2, key, reason)


def test_text_and_binary_pictures_are_equal() -> None:
    expected = np.array(ROWS) / 255
    assert np.allclose(parse_pgm(P5, "x.pgm"), expected)
    assert np.allclose(parse_pgm(P2, "x.pgm"), expected)


def test_largest_value_is_white() -> None:
    assert parse_pgm(b"P2 3 1 4 0 2 4", "x.pgm").tolist() == [[0.0, 0.5, 1.0]]


def test_values_above_255_are_big_endian_16_bit() -> None:
    assert parse_pgm(b"P5 2 1 1000 \x03\xe8\x01\xf4", "x.pgm").tolist() == [[1.0, 0.5]]


def test_comments_may_appear_anywhere_before_the_pixels() -> None:
    data = b"P5 # one\n#two\n 2 # three\n1\n#four\n255\n\x00\xff"
    assert parse_pgm(data, "x.pgm").tolist() == [[0.0, 1.0]]
    assert parse_pgm(b"P2\n2 1\n1\n0 # a comment\n1\n", "x.pgm").tolist() == [[0.0, 1.0]]


def test_pixel_may_have_the_value_of_a_blank() -> None:
    assert parse_pgm(b"P5 2 1 255\n\n\n", "x.pgm").shape == (1, 2)
    assert parse_pgm(b"P5 1 1 255\n \n", "x.pgm").shape == (1, 1)


BAD = [
    (b"", "format", "empty"),
    (b"P5", "format", "starts with b'P5'"),
    (b"P55 1 1 255 x", "format", "starts with"),
    (b"P6 1 1 255 abc", "format", "a PPM picture (colours)"),
    (b"P4 8 1 x", "format", "a PBM picture"),
    (b"\x89PNG\r\n\x1a\n", "format", "a PNG picture"),
    (b"\xff\xd8\xff\xe0", "format", "a JPEG picture"),
    (b"hello", "format", "starts with b'hello'"),
    (b"P5 ", "width", "the file ends"),
    (b"P5 0 1 255 ", "width", "'0'"),
    (b"P5 -3 1 255 ", "width", "'-3'"),
    (b"P5 3.5 1 255 ", "width", "'3.5'"),
    (b"P5 99999999999 1 255 ", "width", "'99999999999'"),
    (b"P5 3", "height", "the file ends"),
    (b"P5 3 # 4 5", "height", "the file ends"),
    (b"P5 3 1 0 abc", "maxval", "'0'"),
    (b"P5 3 1 65536 abc", "maxval", "'65536'"),
    (b"P5 3 1 255", "raster", "missing"),
    (b"P5 3 1 255\nab", "raster", "2 bytes, but width times height needs 3"),
    (b"P5 3 1 255\nabcd", "raster", "4 bytes, but width times height needs 3"),
    (b"P5 2 1 256\nabc", "raster", "3 bytes, but width times height needs 4"),
    (b"P5 2 1 100\nab\xff", "raster", "3 bytes"),
    (b"P5 2 1 100\na\xff", "raster", "a value of 255, but maxval is 100"),
    (b"P2 3 1 255 1 2", "raster", "2 numbers, but width times height needs 3"),
    (b"P2 2 1 255 1 2 3", "raster", "3 numbers"),
    (b"P2 2 1 255 1 x", "raster", "'x' is no whole number"),
    (b"P2 2 1 255 1 -2", "raster", "'-2' is no whole number"),
    (b"P2 2 1 255 1 256", "raster", "a value of 256, but maxval is 255"),
]


@each(("data", "key", "reason"), BAD)
def test_invalid_picture_is_rejected_by_key(data: bytes, key: str, reason: str) -> None:
    problem = refused(lambda: parse_pgm(data, "bad.pgm"))
    assert (problem.file, problem.key) == ("bad.pgm", key)
    assert reason in problem.reason


@settings(max_examples=500)
@given(st.sampled_from((P2, P5)), st.integers(0, 90), st.binary(max_size=12), st.booleans())
def test_damaged_picture_is_read_or_rejected(good: bytes, at: int, noise: bytes, cut: bool) -> None:
    data = good[:at] + noise + (b"" if cut else good[at:])
    try:
        found = parse_pgm(data, "x.pgm")
    except WorldError:
        return
    assert found.ndim == 2
    assert ((found >= 0.0) & (found <= 1.0)).all()


@settings(max_examples=300)
@given(st.binary(max_size=40))
def test_any_bytes_raise_only_import_errors(noise: bytes) -> None:
    for data in (noise, b"P5 " + noise, b"P2 3 2 " + noise):
        with suppress(WorldError):
            assert parse_pgm(data, "x.pgm").size > 0


@given(st.integers(1, 6), st.integers(1, 6), st.integers(1, 65535), st.data())
def test_written_picture_is_read_back(
    width: int, height: int, most: int, data: st.DataObject
) -> None:
    values = data.draw(
        st.lists(st.integers(0, most), min_size=width * height, max_size=width * height)
    )
    head = f"{width} {height} {most}\n"
    raw = np.array(values, dtype=">u1" if most < 256 else ">u2").tobytes()
    expected = np.array(values).reshape(height, width) / most
    assert (parse_pgm(b"P5 " + head.encode() + raw, "x") == expected).all()
    text = f"P2 {head}" + " ".join(str(value) for value in values)
    assert (parse_pgm(text.encode(), "x") == expected).all()


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


BAD_ROS_MAPS = [
    ("no image", YAML.replace("image: hand.pgm\n", ""), None, "image", "missing"),
    ("empty image", YAML.replace("hand.pgm", ""), 1, "image", "expected text"),
    ("png", YAML.replace("hand.pgm", "hand.png"), 1, "image", "hand.png is no .pgm file"),
    ("no number", YAML.replace("0.5 ", "half "), 2, "resolution", "'half' is not a number"),
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


@each(("story", "text", "line", "key", "reason"), BAD_ROS_MAPS)
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


def saved(folder: Path, grid: object) -> Path:
    path = folder / "grid_0.npy"
    np.save(path, np.asarray(grid))
    return path


def places(field: CylinderField) -> set[tuple[float, float]]:
    return {(one.x_m, one.y_m) for one in field.cylinders}


def test_grid_becomes_cylinders_with_free_floor_at_both_ends(
    tmp_path: Path,
) -> None:
    grid = np.zeros((30, 20), dtype=int)
    grid[0, 0] = grid[29, 19] = 1
    field = load_grid(saved(tmp_path, grid))
    assert field.size_m == (2 * BEFORE_M + 3.0, 4.5)
    # Row 0 is on the left of a robot that drives along the columns.
    assert places(field) == {(BEFORE_M + 0.075, 4.425), (BEFORE_M + 2.925, 0.075)}
    assert {one.radius_m for one in field.cylinders} == {0.075}
    assert field.ends == ((0.75, 2.25), (5.25, 2.25))


def test_fully_surrounded_cylinder_is_omitted(tmp_path: Path) -> None:
    grid = np.zeros((6, 6), dtype=np.int64)
    grid[1:4, 1:4] = 1
    assert len(load_grid(saved(tmp_path, grid)).cylinders) == 8
    # Those on the rim of the field stay.
    assert len(load_grid(saved(tmp_path, np.ones((3, 3)))).cylinders) == 8


def test_pitch_scales_the_cylinders(tmp_path: Path) -> None:
    field = load_grid(saved(tmp_path, [[1, 0], [0, 0]]), pitch_m=0.3)
    assert field.size_m == (3.6, 0.6)
    assert field.cylinders[0].radius_m == 0.15


@pytest.mark.parametrize("kind", ["bool", "uint8", "int32", "int64", "float64"])
def test_any_numeric_type_is_accepted(tmp_path: Path, kind: str) -> None:
    field = load_grid(saved(tmp_path, np.eye(4).astype(kind)))
    assert len(field.cylinders) == 4


@each(
    ("grid", "reason"),
    [
        ([0, 1, 0], "found shape (3,)"),
        ([[0, 2]], "neither 0 nor 1"),
        ([[0.0, float("nan")]], "neither 0 nor 1"),
        ([["a", "b"]], "expected a table of numbers, found '<U1'"),
        (np.zeros((0, 3)), "a side must be"),
        (np.zeros((1001, 1)), "1001 x 1"),
    ],
)
def test_invalid_grid_is_rejected(tmp_path: Path, grid: object, reason: str) -> None:
    path = saved(tmp_path, grid)
    problem = refused(lambda: load_grid(path))
    assert (problem.file, problem.key) == (str(path), "npy")
    assert reason in problem.reason


def test_pickled_objects_are_never_opened(tmp_path: Path) -> None:
    path = tmp_path / "grid_0.npy"
    np.save(path, np.array([{"a": 1}], dtype=object), allow_pickle=True)
    assert "found '|O'" in refused(lambda: load_grid(path)).reason


def test_archive_of_grids_is_rejected(tmp_path: Path) -> None:
    path = tmp_path / "grid_0.npz"
    np.savez(path, np.zeros((3, 3)))
    assert "no .npy file" in refused(lambda: load_grid(path)).reason


def test_column_major_table_is_read_the_same(tmp_path: Path) -> None:
    grid = np.zeros((3, 5))
    grid[0, 4] = 1
    by_rows = load_grid(saved(tmp_path, grid))
    assert load_grid(saved(tmp_path, np.asfortranarray(grid))) == by_rows


@settings(max_examples=200, deadline=None)
@given(st.integers(0, 200), st.binary(max_size=20), st.booleans())
def test_damaged_grid_is_read_or_rejected(
    tmp_path_factory: pytest.TempPathFactory, at: int, noise: bytes, cut: bool
) -> None:
    buffer = io.BytesIO()
    np.save(buffer, np.eye(3, dtype=np.int64))
    data = buffer.getvalue()
    path = tmp_path_factory.getbasetemp() / "spoilt.npy"
    path.write_bytes(data[:at] + noise + (b"" if cut else data[at:]))
    with suppress(WorldError):
        assert len(load_grid(path).cylinders) <= 9


def test_list_rows_are_x_y_and_optional_radius() -> None:
    field = parse_list("x,y,radius\n# two of them\n2.0, -1.0\n\n4.0; 1.0; 0.2\n", "list.csv")
    assert field.corner == pytest.approx((0.925, -2.075))
    assert [one.radius_m for one in field.cylinders] == [0.075, 0.2]
    assert (field.cylinders[0].x_m, field.cylinders[0].y_m) == pytest.approx((1.075, 1.075))
    assert field.size_m == pytest.approx((4.275, 4.275))
    assert field.ends is None


def test_comma_between_semicolons_is_a_decimal_mark() -> None:
    (cylinder,) = parse_list("x;y;radius\n1,5;0,3;0,25\n", "list.csv").cylinders
    assert cylinder.radius_m == 0.25
    assert cylinder.y_m - cylinder.x_m == 0.0


def test_duplicate_cylinder_is_kept_once() -> None:
    assert len(parse_list("1 1\n1 1\n2 2\n", "list.txt").cylinders) == 2


@each(
    ("text", "line", "key"),
    [
        ("", None, "cylinders"),
        ("# nothing\n", None, "cylinders"),
        ("1.0\n", 1, "cylinder"),
        ("1 2 3 4\n", 1, "cylinder"),
        ("1 2\n1 two\n", 2, "cylinder"),
        ("1 nan\n", 1, "cylinder"),
        ("1 inf\n", 1, "cylinder"),
        ("1 1e7\n", 1, "cylinder"),
        ("1 2 0\n", 1, "cylinder"),
        ("1 2 -0.1\n", 1, "cylinder"),
        ("1 2\nx,y\n", 2, "cylinder"),
        ("1,2 3\n", 1, "cylinder"),
    ],
)
def test_invalid_list_is_rejected_with_its_line(text: str, line: int | None, key: str) -> None:
    problem = refused(lambda: parse_list(text, "list.csv"))
    assert (problem.file, problem.line, problem.key) == ("list.csv", line, key)


def test_binary_list_is_rejected(tmp_path: Path) -> None:
    path = tmp_path / "list.csv"
    path.write_bytes(b"1 2\n\xff\xfe\n")
    problem = refused(lambda: load_list(path))
    assert (problem.line, problem.reason) == (2, "not UTF-8 text")
