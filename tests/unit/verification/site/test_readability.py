"""Reading grade of the tutorial and the guides."""

from pathlib import Path
from statistics import median

import pytest

from verification.site.readability import MAX_GRADE, grade, grades, sentences_of, syllables

DOCS = Path(__file__).resolve().parents[4] / "docs"
PAGE = """\
# A heading of many syllables

The [robot](page.md) turns. `sidestep goto` ends:

- one item
- another item

```text
Code is not read. It is code.
```

| a | table |
"""


def test_tutorial_and_guides_are_easy_to_read() -> None:
    assert median(grades(DOCS).values()) <= MAX_GRADE


@pytest.mark.parametrize(
    ("word", "count"),
    [
        ("robot", 2),
        ("drive", 1),
        ("table", 2),
        ("started", 2),
        ("turned", 1),
        ("uncertainty", 4),
        ("navigator", 4),
        ("20", 1),
        ("the", 1),
    ],
)
def test_syllables_are_counted(word: str, count: int) -> None:
    assert syllables(word) == count


def test_only_running_text_counts() -> None:
    expected = [["The", "robot", "turns"], ["it", "ends"], ["one", "item"], ["another", "item"]]
    assert list(sentences_of(PAGE)) == expected


def test_grade_is_that_of_flesch_and_kincaid() -> None:
    """Two sentences of three words, and seven syllables in six words."""
    assert grade("The robot turns. Dogs run fast.") == pytest.approx(
        0.39 * 3 + 11.8 * 7 / 6 - 15.59
    )
    assert grade("```text\ncode\n```\n") == 0.0


def test_long_words_raise_the_grade() -> None:
    hard = "Comparative implementation necessitates considerable sophistication."
    assert grade(hard) > 20 > grade("The dog sat.")
