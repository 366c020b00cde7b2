"""The history is bounded, without repetitions, and survives a damaged file."""

from pathlib import Path

from hypothesis import given
from hypothesis import strategies as st

from ground.console.history import History


def test_history_moves_both_ways_and_restores_the_draft() -> None:
    history = History()
    for line in ("arm", "goal 1 2", "hold", "goal 3 4"):
        history.add(line)
    assert history.previous("go") == "goal 3 4"
    assert history.previous("goal 3 4") == "goal 1 2"
    assert history.previous("goal 1 2") == "goal 1 2"
    assert history.next("goal 1 2") == "goal 3 4"
    assert history.next("goal 3 4") == "go"
    assert history.next("go") == "go"


def test_repeated_and_empty_lines_are_not_kept() -> None:
    history = History()
    for line in ("hold", "hold ", "", "arm", "hold", "a\x1bb"):
        history.add(line)
    assert history.lines == ["hold", "arm", "hold"]


def test_the_file_is_read_again_and_stays_bounded(tmp_path: Path) -> None:
    path = tmp_path / "state" / "history"
    history = History(path, most=3)
    for number in range(9):
        history.add(f"goal {number} 0")
    assert History(path, most=3).lines == ["goal 6 0", "goal 7 0", "goal 8 0"]
    assert path.stat().st_mode & 0o077 == 0
    assert [one.name for one in path.parent.iterdir()] == ["history"]


def test_a_broken_file_is_no_reason_to_fail(tmp_path: Path) -> None:
    path = tmp_path / "history"
    path.write_bytes(b"hold\n\xff\xfe\x00\n\x1b[2J\narm\n")
    assert History(path).lines[0] == "hold"
    assert History(path).lines[-1] == "arm"
    history = History(tmp_path)
    assert "not a regular file" in history.trouble
    history.add("hold")
    assert history.lines == ["hold"]
    assert history.trouble


@given(st.lists(st.text()), st.lists(st.booleans()))
def test_walking_never_leaves_what_is_there(lines: list[str], steps: list[bool]) -> None:
    history = History(most=5)
    for line in lines:
        history.add(line)
    assert len(history.lines) <= 5
    shown = ""
    for back in steps:
        shown = history.previous(shown) if back else history.next(shown)
        assert shown in {"", *history.lines}


def test_history_is_searched_for_words_newest_first() -> None:
    history = History()
    for line in ("goal 1 2", "hold", "goal 3 4", "goal 1 2", "mode hold"):
        history.add(line)
    assert history.search("GO 2") == ["goal 1 2"]
    assert history.search("ho") == ["mode hold", "hold"]
    assert history.search("")[0] == "mode hold"
    assert history.uses() == {"goal": 3, "hold": 1, "mode": 1}
