"""The advice on plain English: which texts it reads, which habits it finds, how it grades."""

from pathlib import Path

import pytest

from checks.language import Text, grade, habits, main, running_text, syllables, texts_of
from tests.support.each import each


@each(
    ("words", "expected"),
    [
        ("Return the pose of a robot whose plant has exited.", []),
        ("Tell whoever listens that nobody stands there.", ["person", "human verb"]),
        ("What a robot publishes.", ["opening"]),
        ("A robot that drives.", ["opening"]),
        ("Standard output of a person.", []),
    ],
)
def test_habits_of_a_function_docstring_are_found(words: str, expected: list[str]) -> None:
    assert list(habits(Text("docstring", Path("x.py"), 1, words, is_function=True))) == expected


def test_class_docstring_may_be_a_noun_phrase() -> None:
    assert not list(habits(Text("docstring", Path("x.py"), 1, "A robot that drives.")))


def test_texts_of_a_module_are_found_by_kind(tmp_path: Path) -> None:
    path = tmp_path / "module.py"
    path.write_text(
        '"""A module."""\n\nNAME = "key"\n\n\ndef check(count: int) -> str:\n'
        '    """Return a message."""\n    # a reason\n    return f"found {count} of them"\n'
    )
    assert [(text.kind, text.words) for text in texts_of(path)] == [
        ("docstring", "A module."),
        ("docstring", "Return a message."),
        ("message", "found _ of them"),
        ("comment", "a reason"),
    ]


def test_code_blocks_of_a_page_are_skipped(tmp_path: Path) -> None:
    path = tmp_path / "page.md"
    path.write_text(
        "# A heading here\n\n```sh\nwho tells me\n```\n\nRun `who am i` first. Then stop it.\n"
    )
    assert [text.words for text in texts_of(path)] == [
        "# A heading here",
        "Run `_` first.",
        "Then stop it.",
    ]


@each(
    ("word", "count"),
    [("robot", 2), ("drive", 1), ("table", 2), ("started", 2), ("turned", 1), ("20", 1)],
)
def test_syllables_are_counted(word: str, count: int) -> None:
    assert syllables(word) == count


def test_grade_is_that_of_flesch_and_kincaid() -> None:
    """Use two sentences of three words, with seven syllables in six words."""
    assert grade("The robot turns. Dogs run fast.") == pytest.approx(
        0.39 * 3 + 11.8 * 7 / 6 - 15.59
    )
    assert grade("```text\ncode\n```\n") == 0.0


def test_only_running_text_is_graded() -> None:
    page = (
        "# A heading of many syllables\n\nThe [robot](page.md) turns. `sidestep goto` ends:\n\n"
        "- one item\n- another item\n\n```text\nCode is not read.\n```\n\n| a | table |\n"
    )
    expected = [["The", "robot", "turns"], ["it", "ends"], ["one", "item"], ["another", "item"]]
    assert list(running_text(page)) == expected


def test_suggestions_never_fail(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    module, broken, page = (tmp_path / name for name in ("a.py", "b.py", "c.md"))
    module.write_text('def f():\n    """Returns what a robot says."""\n')
    broken.write_text("def f(:\n")
    page.write_text("Comparative implementation necessitates considerable sophistication.\n")
    assert main([str(module), str(broken), str(page), str(tmp_path / "none")]) == 0
    printed = capsys.readouterr().out
    for words in (
        "a.py:2: docstring: human verb: Returns what",
        "a.py:2: docstring: verb: ",
        "b.py: not read: ",
        "c.md: page: reading grade ",
        "none: no such file or folder",
    ):
        assert words in printed
