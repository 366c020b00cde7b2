"""Test columns: heads, order, and the row that is chosen."""

from typing import NamedTuple

from ground.app.lists.table import Column, Table
from ground.app.widgets.rows import words_of


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
