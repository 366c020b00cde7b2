import io
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from plant.imports.barn import BEFORE_M, CylinderField, load_grid, load_list, parse_list
from plant.model.errors import WorldError
from tests.support.each import each
from tests.support.plant.imports.files import refused


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


@pytest.mark.parametrize(
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
