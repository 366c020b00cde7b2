"""The cause of an exit is described in words that follow the process name."""

from ground.launch.supervisor import MAX_CAUSE_CHARS, cause_of
from tests.support.each import each

INTERNAL_ERROR = (
    "robot r1: ready, disarmed\n"
    "sidestep run robot: internal error: ZeroDivisionError: as wanted (/x/brain.py:3)\n"
    "for the traceback: sidestep --traceback robot ..."
)

RESTARTED = "robot r1: ready, disarmed\nrobot r1: ends for a restart on request\n"


@each(
    ("role", "code", "words", "expected"),
    [
        ("robot r1", -9, "robot r1: ready", "was killed (signal SIGKILL)"),
        ("robot r1", -14, "", "hung (its loop did not run for 5 s)"),
        ("robot r1", 1, INTERNAL_ERROR, "ended by a core exception (ZeroDivisionError: as wanted"),
        ("plant", 1, INTERNAL_ERROR, "ended by an exception (ZeroDivisionError: as wanted"),
        ("plant", 2, "  there is one already\n\n", "(exit code 2: there is one already)"),
        ("robot r1", 0, "", "exited unexpectedly (exit code 0)"),
        ("robot r1", 0, RESTARTED, "ended for a restart on request"),
    ],
)
def test_cause_combines_exit_code_and_output(
    role: str, code: int, words: str, expected: str
) -> None:
    assert expected in cause_of(role, code, words)


def test_cause_is_limited_in_length() -> None:
    assert len(cause_of("plant", 3, "x" * 5000)) == MAX_CAUSE_CHARS
