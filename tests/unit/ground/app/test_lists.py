"""The lists of the app: the words that filter them, columns, order and the chosen row."""

from typing import NamedTuple

from hypothesis import given
from hypothesis import strategies as st

from ground.app.lists.table import Column, ListFilter, Table
from ground.app.widgets.rows import words_of
from tests.support.each import each

COLUMNS = ("name", "unit")
ROW = {"name": "D_obs_m radius", "unit": "m/s"}
LETTERS = st.text(st.sampled_from("nam:e unit/s"), max_size=12)


@each(
    ("words", "passes"),
    [
        ("", True),
        ("   ", True),
        ("d_OBS", True),
        ("radius d_obs", True),
        ("radius zone", False),
        ("name:radius", True),
        ("unit:radius", False),
        ("unit:m name:obs", True),
        ("unit:", True),
        ("tcp:m", False),
        ("alias:m/s", True),
    ],
)
def test_row_contains_all_words(words: str, passes: bool) -> None:
    assert ListFilter(words, COLUMNS, {"alias": "unit"}).passes(ROW) is passes


def test_prefix_without_a_column_is_text() -> None:
    assert ListFilter("tcp:7447", COLUMNS).passes({"name": "tcp:7447", "unit": ""})


@given(LETTERS, LETTERS, st.lists(st.tuples(LETTERS, LETTERS), max_size=5))
def test_narrower_filter_passes_no_other_rows(
    before: str, after: str, rows: list[tuple[str, str]]
) -> None:
    old, new = ListFilter(before, COLUMNS), ListFilter(after, COLUMNS)
    if new.narrows(old):
        for name, unit in rows:
            cells = {"name": name, "unit": unit}
            assert old.passes(cells) or not new.passes(cells)


def test_appended_letters_narrow_a_filter() -> None:
    assert ListFilter("lin").narrows(ListFilter("li"))
    assert ListFilter("li x").narrows(ListFilter("li"))
    assert not ListFilter("li").narrows(ListFilter("lin"))
    assert not ListFilter("name: x", COLUMNS).narrows(ListFilter("name", COLUMNS))


class Stream(NamedTuple):
    name: str
    loss: float | None


ROWS = [Stream("pose", 0.0), Stream("sonar", 12.5), Stream("beat", None), Stream("wheel", 3.0)]


def table() -> Table[Stream]:
    return Table(
        (
            Column("stream", 8, lambda one: one.name),
            Column(
                "loss", 8, lambda one: f"{one.loss}", lambda one: one.loss, unit="%", numeric=True
            ),
        ),
        key=lambda one: one.name,
    )


def names(one: Table[Stream]) -> list[str]:
    return [row.name for row in one.rows]


def test_list_is_sorted_by_each_column_in_turn() -> None:
    listed = table()
    listed.update(ROWS, "", 0)
    assert names(listed) == ["pose", "sonar", "beat", "wheel"]
    listed.sort_by_next()
    listed.update(ROWS, "", 0)
    assert names(listed) == ["beat", "pose", "sonar", "wheel"]
    listed.sort_by_next()
    listed.update(ROWS, "", 0)
    assert names(listed) == ["sonar", "wheel", "pose", "beat"]
    listed.turn()
    listed.update(ROWS, "", 0)
    assert names(listed) == ["pose", "wheel", "sonar", "beat"]
    listed.sort_by_next()
    listed.update(ROWS, "", 0)
    assert names(listed) == ["pose", "sonar", "beat", "wheel"]


def test_choice_follows_its_row() -> None:
    listed = table()
    listed.update(ROWS, "", 0)
    listed.sort_by(1)
    assert listed.update(ROWS, "", 1) == 0
    assert listed.update(ROWS, "wheel", 0) == 0
    assert listed.update(ROWS, "", 0) == 1


def test_head_has_unit_and_mark_above_its_column() -> None:
    listed = table()
    assert words_of(listed.heads()) == " stream     loss % "
    listed.sort_by(1)
    assert words_of(listed.heads()) == " stream    ▼loss % "
    listed.turn()
    assert words_of(listed.heads()) == " stream    ▲loss % "
    assert words_of(listed.paint(ROWS[1], False)) == " sonar        12.5 "


def test_column_is_found_by_position() -> None:
    listed = table()
    assert [listed.column_at(x) for x in (0, 1, 8, 10, 18, 70)] == [0, 0, 0, 1, 1, 1]


def test_long_text_is_cut_to_its_column() -> None:
    listed = table()
    painted = words_of(listed.paint(Stream("a_long_name_of_a_stream", 1.0), True))
    assert painted == " a_long_…      1.0 "
