"""The progress line shows how far a study is and how long it will take."""

from io import StringIO

from hypothesis import given
from hypothesis import strategies as st

from study.runner.conduct import StudyProgress, duration_text
from tests.support.each import each
from tests.support.study.made import Watch, rows


class Terminal(StringIO):
    def isatty(self) -> bool:
        return True


def test_line_shows_trials_rate_and_time_left() -> None:
    watch, file = Watch(), StringIO()
    progress = StudyProgress(100, 10, file, watch)
    for row in rows(30, time_s=120.0):
        progress.add(row)
    watch.now_s += 60.0
    progress.show_if_due()
    assert file.getvalue() == ("40/100 trials (40 %), 1.0 simulated h/min, 2 min left, 30 failed\n")


def test_no_time_left_before_the_first_trial() -> None:
    file = StringIO()
    StudyProgress(5, 0, file, Watch()).show_if_due()
    assert file.getvalue() == "0/5 trials (0 %)\n"


def test_terminal_line_is_overwritten() -> None:
    watch, file = Watch(), Terminal()
    progress = StudyProgress(5, 0, file, watch)
    for _ in range(4):
        watch.now_s += 1.0
        progress.show_if_due()
    progress.close()
    assert file.getvalue().count("\n") == 1
    assert file.getvalue().count("\r") == 5


def test_log_lines_are_sparse() -> None:
    watch, file = Watch(), StringIO()
    progress = StudyProgress(5, 0, file, watch)
    for _ in range(600):
        watch.now_s += 0.1
        progress.show_if_due()
    assert 2 <= file.getvalue().count("\n") <= 3


def test_failed_trial_does_not_change_simulated_time() -> None:
    progress = StudyProgress(5, 0, StringIO(), Watch())
    for row in rows(3):
        progress.add(row)
    assert progress.simulated_s == 0.0


@each(
    ("span_s", "words"),
    [(0.0, "0 s"), (89.4, "89 s"), (90.0, "2 min"), (3600.0, "60 min"), (11_100.0, "3 h 05 min")],
)
def test_durations_are_formatted_by_magnitude(span_s: float, words: str) -> None:
    assert duration_text(span_s) == words


@given(st.integers(0, 50), st.integers(0, 50), st.floats(0.0, 1e6))
def test_line_is_valid_for_any_progress(before: int, now: int, elapsed_s: float) -> None:
    watch = Watch()
    progress = StudyProgress(before + now + 1, before, StringIO(), watch)
    for row in rows(now):
        progress.add(row)
    watch.now_s += elapsed_s
    assert f"{before + now}/{before + now + 1} trials" in progress.line()
