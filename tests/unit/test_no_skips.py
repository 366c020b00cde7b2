"""In CI a skipped test fails the run."""

import re
from collections.abc import Iterator

import pytest
from hypothesis import settings

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
    settings = pytester.makeini("[pytest]")
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
