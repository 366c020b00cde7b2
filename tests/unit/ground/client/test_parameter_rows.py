"""The robot's parameter list is bounded, typed, printable, and safe to write to a file."""

import json
import tomllib
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from ground.client import parameter_file
from ground.client.operations.parameters import table
from ground.client.parameter import Parameter, parameters_in
from ground.client.parameter_rows import MAX_ROWS, MAX_TEXT, rows_in
from runtime.errors import RemoteError
from tests.support.each import each
from tests.support.hostile import TEXT, raw_in

NAMES = st.text(min_size=1, max_size=18) | st.from_regex(r"[A-Za-z0-9_]{1,16}", fullmatch=True)
TEXTS = st.text() | st.just('x"\n[network]\nconnect = ["tcp/evil:1"]\n#')
NUMBERS = st.floats() | st.integers() | st.booleans() | st.none()
LISTS = st.lists(
    st.fixed_dictionaries(
        {"name": NAMES, "value": NUMBERS},
        optional={"default": NUMBERS, "unit": TEXTS, "doc": TEXTS, "minimum": NUMBERS},
    ),
    max_size=4,
)


def answer(**more: object) -> bytes:
    return json.dumps([{"name": "d_obs_m", "value": 0.3, **more}]).encode()


@each(
    ("found", "why"),
    [
        (answer(name="a = 1\n[network]\nb"), "has no name"),
        (answer(name="x" * 17), "has no name"),
        (answer(name=["a"]), "has no name"),
        (answer(value="0.3"), "no finite number as its value"),
        (answer(value=True), "no finite number as its value"),
        (answer(value=float("nan")), "no finite number as its value"),
        (answer(value=1e999), "no finite number as its value"),
        (answer(default={}), "has a default"),
        (answer(minimum="low"), "has a minimum"),
        (answer(doc=["a"]), "has a doc"),
        (answer(unit=3), "has a unit"),
        (answer(**{f"k{i}": 1 for i in range(50)}), "is not a table"),
        (b"[3]", "is not a table"),
        (b"{}", "not a list"),
        (
            json.dumps([{"name": "a", "value": 1}] * (MAX_ROWS + 1)).encode(),
            "not a list of at most",
        ),
        (json.dumps([{"name": "a", "value": 1}] * 2).encode(), "duplicate name"),
        (b"[" * 100_000, "nested too deeply"),
        (b"\xff", "cannot read the parameter list"),
    ],
)
def test_a_malformed_list_is_refused(found: bytes, why: str) -> None:
    with pytest.raises(RemoteError, match=why):
        rows_in(found)


def test_texts_are_one_printable_line_of_bounded_length() -> None:
    (row,) = rows_in(answer(doc=TEXT + "\n", unit=TEXT, note="d" * 1000, nested=[1], empty=None))
    assert raw_in(f"{row['doc']}{row['unit']}") == []
    assert "\n" not in str(row["doc"])
    assert len(str(row["note"])) == MAX_TEXT
    assert "nested" not in row
    found = parameters_in(answer(doc=TEXT + "\n", unit=TEXT))
    assert "\n" not in table(found).partition("\n")[2]


@given(LISTS)
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_a_saved_list_holds_parameters_and_nothing_else(
    tmp_path: Path, listed: list[dict[str, object]]
) -> None:
    """Keep a hostile robot from adding tables such as [network] to the file."""
    path = tmp_path / "p.toml"
    try:
        found = parameters_in(json.dumps(listed))
    except RemoteError:
        return
    unlike = {one.name: one.value for one in found if not one.is_default}
    names = parameter_file.write(path, found)
    assert tomllib.loads(path.read_text(encoding="utf-8")) == {"parameters": unlike}
    assert sorted(unlike) == sorted(names)


@given(TEXTS)
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_no_meaning_of_a_parameter_ends_its_comment(tmp_path: Path, doc: str) -> None:
    path = tmp_path / "p.toml"
    parameter_file.write(path, [Parameter(name="a", value=2.0, default=1.0, doc=doc)])
    assert tomllib.loads(path.read_text(encoding="utf-8")) == {"parameters": {"a": 2.0}}
