"""The English of the project stays plain: each habit is in at most 1 % of the texts of a kind."""

from pathlib import Path

import pytest

from verification.language import (
    HABITS,
    KINDS,
    MAX_SHARE,
    ROOT,
    Text,
    files,
    habits,
    main,
    measured,
    texts_of,
)


def test_each_habit_is_in_few_texts_of_each_kind() -> None:
    count, found = measured(text for path in files([ROOT]) for text in texts_of(path))
    for kind in KINDS:
        assert count[kind] > 100, kind
        for habit in HABITS:
            texts = found[kind, habit]
            places = [f"{text.path.relative_to(ROOT)}:{text.line}" for text in texts]
            assert len(texts) <= MAX_SHARE * count[kind], (kind, habit, places)


@pytest.mark.parametrize(
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


def test_exit_code_names_a_share_above_the_limit(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([str(ROOT / "runtime")]) == 0
    assert "docstring" in capsys.readouterr().out
