"""The hooks of tests/conftest.py, and tables that are one test."""

import os
import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import settings

from tests.support.each import each

pytest_plugins = ["pytester"]

GO_ON = "--continue-on-collection-errors"
PASSES = "def test_passes():\n    pass\n"
SKIPS = "import pytest\n@pytest.mark.skipif(True, reason='no such tool')\ndef test_s():\n    pass\n"
SKIPS_INSIDE = "import pytest\ndef test_s():\n    pytest.skip('no such tool')\n"
MODULE_SKIPS = "import pytest\npytest.skip('no such tool', allow_module_level=True)\n"
EXPECTED_FAILURE = (
    "import pytest\n@pytest.mark.xfail(reason='known')\ndef test_x():\n    raise ValueError\n"
)


def run_pytest(pytester: pytest.Pytester, sources: list[str], *options: str) -> pytest.RunResult:
    """Run pytest within this process, with the hooks of all tests."""
    pytester.makepyfile(**{f"test_{number}": source for number, source in enumerate(sources)})
    settings = pytester.makeini(
        "[pytest]\nmarkers =\n    realtime: alone\n    sweep(n): thinned out\n"
    )
    words = ("-q", "-p", "no:cacheprovider", "-p", "tests.conftest", "-c", str(settings))
    return pytester.runpytest_inprocess(*words, *options)


@pytest.fixture(autouse=True)
def _whole_reasons(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let pytest shorten no line of its summary to the width of a terminal."""
    monkeypatch.setenv("COLUMNS", "200")


@pytest.fixture(autouse=True)
def _kept_profile() -> Iterator[None]:
    """Restore the profile of Hypothesis, which the inner run sets for the whole process."""
    before = settings.get_current_profile_name()
    yield
    settings.load_profile(before)


def test_skip_fails_the_run_in_ci_with_the_reason(pytester: pytest.Pytester) -> None:
    run = run_pytest(pytester, [SKIPS, SKIPS_INSIDE, MODULE_SKIPS, PASSES], "--no-skips", GO_ON)
    assert run.ret != 0
    summary = run.stdout.str().partition("short test summary")[2]
    for number in range(3):
        assert re.search(rf"test_{number}\.py.* - .*--no-skips forbids: .*no such tool", summary), (
            run.stdout.str()
        )
    assert "test_3" not in summary


def test_elsewhere_a_skip_is_only_reported(pytester: pytest.Pytester) -> None:
    assert run_pytest(pytester, [PASSES + SKIPS]).ret == 0


def test_passing_and_expected_failing_tests_are_unchanged(pytester: pytest.Pytester) -> None:
    assert run_pytest(pytester, [PASSES + EXPECTED_FAILURE], "--no-skips").ret == 0


TABLE = """
import pytest
from tests.support.each import each

@each("text, length", [("a", 1), ("bb", 3), ("ccc", 4)])
def test_lengths(text, length, tmp_path):
    assert len(text) == length

@each("first", [1, 2])
@each("second", [1, 2])
def test_combinations(first, second):
    assert first + second < 4

@each("tool", ["there", "missing"])
def test_tools(tool):
    if tool == "missing":
        pytest.skip("no such tool")
"""
SWEEP = """
import pytest

@pytest.mark.sweep(3)
@pytest.mark.parametrize("row", range(7))
def test_row(row):
    pass

@pytest.mark.realtime
def test_other():
    pass
"""


def test_each_row_that_fails_is_reported_with_its_values(pytester: pytest.Pytester) -> None:
    run = run_pytest(pytester, [TABLE])
    assert run.ret == pytest.ExitCode.TESTS_FAILED
    shown = run.stdout.str().partition("short test summary")[2]
    failed = re.findall(r"SUBFAILED\[(.*?)\] \S+::(\w+)", shown)
    assert failed == [
        ("text='bb', length=3", "test_lengths"),
        ("text='ccc', length=4", "test_lengths"),
        ("first=2, second=2", "test_combinations"),
    ]


def test_row_that_is_skipped_fails_in_ci(pytester: pytest.Pytester) -> None:
    run = run_pytest(pytester, [TABLE], "--no-skips", "-k", "test_tools")
    assert run.ret == pytest.ExitCode.TESTS_FAILED
    assert "--no-skips forbids: Skipped: no such tool" in run.stdout.str()


def test_table_that_cannot_fail_or_does_not_fit_is_refused() -> None:
    with pytest.raises(ValueError, match="no rows for text"):
        each("text", [])
    with pytest.raises(ValueError, match="3 values for text, length: "):
        each("text, length", [("a", 1, 2)])


@each(("examples", "passed"), [("brief", 4), ("long", 8)])
def test_sweep_is_whole_only_with_many_examples(
    examples: str, passed: int, pytester: pytest.Pytester
) -> None:
    run = run_pytest(pytester, [SWEEP], "--examples", examples)
    assert run.parseoutcomes()["passed"] == passed


def test_tests_of_real_time_report_the_load(pytester: pytest.Pytester) -> None:
    shown = run_pytest(pytester, [SWEEP]).stdout.str()
    assert re.search(
        r"load average met by tests of real time: [\d.]+ to [\d.]+ on \d+ cores", shown
    )


def test_finished_tests_are_counted_for_the_gate(
    pytester: pytest.Pytester, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    count = tmp_path / "count"
    monkeypatch.setenv("SIDESTEP_TEST_COUNT", str(count))
    run_pytest(pytester, [SWEEP])
    assert count.read_text() == "4 4\n"
    assert "SIDESTEP_TEST_COUNT" not in os.environ, "a pytest that a test starts must not count"
