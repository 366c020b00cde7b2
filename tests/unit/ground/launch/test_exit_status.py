"""How a process ended is said in words that follow its name."""

import pytest

from ground.launch.supervisor import MOST, cause_of

DEFECT = (
    "robot r1: ready, disarmed\n"
    "sidestep robot: internal error: ZeroDivisionError: as wanted (/x/brain.py:3)\n"
    "for the whole story: sidestep --traceback robot ..."
)


@pytest.mark.parametrize(
    ("role", "code", "words", "said"),
    [
        ("robot r1", -9, "robot r1: ready", "was killed (signal SIGKILL)"),
        ("robot r1", -14, "", "hung (its loop did not run for 5 s)"),
        ("robot r1", 1, DEFECT, "ended by a core exception (ZeroDivisionError: as wanted"),
        ("plant", 1, DEFECT, "ended by an exception (ZeroDivisionError: as wanted"),
        ("plant", 2, "  there is one already\n\n", "(exit code 2: there is one already)"),
        ("robot r1", 0, "", "ended by itself (exit code 0)"),
    ],
)
def test_the_cause_is_in_the_code_and_the_last_words(
    role: str, code: int, words: str, said: str
) -> None:
    assert said in cause_of(role, code, words)


def test_a_long_story_is_cut() -> None:
    assert len(cause_of("plant", 3, "x" * 5000)) == MOST
