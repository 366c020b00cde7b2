"""Test the help: every mark of the map has a meaning, and a command opens at its place."""

import pytest

from ground.app.screens.help import MEANINGS, NOTHING_TO_SAY, mark_pairs, sections
from ground.app.widgets.rows import words_of
from ground.map.canvas import MARKS
from ground.map.drawing import seen_mark
from runtime.errors import UserError
from tests.support.each import each
from tests.support.tui.pilot import play, staged


def test_each_mark_of_the_map_has_a_meaning() -> None:
    assert set(MEANINGS) | set(NOTHING_TO_SAY) == set(MARKS)
    for ascii_only in (False, True):
        parts = {part.title: part.rows for part in sections([], ascii_only=ascii_only)}
        words = "\n".join(map(words_of, parts["marks on the map"]))
        dots = () if ascii_only else ("seen", "seen late")  # in colour, echoes are dots
        assert all(MARKS[name][ascii_only] in words for name in MEANINGS if name not in dots)


@each("ascii_only", [False, True])
@each("is_mono", [False, True])
def test_each_mark_in_the_help_has_one_meaning(ascii_only: bool, is_mono: bool) -> None:
    marks = [mark for mark, _ in mark_pairs(ascii_only=ascii_only, is_mono=is_mono)]
    assert len(set(marks)) == len(marks)
    assert not set(" ".join(marks[1:]).split()) & set(marks[0].split())
    seen = seen_mark(ascii_only=ascii_only, is_mono=is_mono)
    assert dict(mark_pairs(ascii_only=ascii_only, is_mono=is_mono))[seen].startswith("walls")


def test_help_of_a_command_comes_first_with_its_example() -> None:
    first = sections([], "goto")[0]
    words = "\n".join(map(words_of, first.rows))
    assert first.title == "goto"
    assert "X Y" in words
    assert "example: :goto" in words
    with pytest.raises(UserError, match="nope"):
        sections([], "nope")


def test_help_scrolls_by_rows_parts_and_to_its_ends() -> None:
    async def story() -> None:
        async with staged() as stage:
            await stage.press("?")
            assert stage.words("help").startswith(" examples")
            await stage.press("tab")
            assert stage.words("help").startswith(" keys: ")
            await stage.press("shift+tab", "down")
            assert "g 3 1 enter" in stage.words("help").splitlines()[0]
            await stage.press("end")
            assert len(stage.words("help").splitlines()) <= 20
            await stage.press("home", "f1")
            assert not stage.app.screen.query("#help")

    play(story)


@each("size", [(20, 5), (1, 1), (40, 12), (200, 60)])
def test_help_opens_in_any_size(size: tuple[int, int]) -> None:
    async def story() -> None:
        async with staged(size) as stage:
            await stage.press("?", "tab", "end", "escape")
            assert not stage.app.screen.query("#help")

    play(story)
