"""Test the words that filter a list."""

from hypothesis import given
from hypothesis import strategies as st

from ground.app.lists.table import ListFilter
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
