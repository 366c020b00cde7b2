"""In CI a test that could not run has not passed."""

import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]
GO_ON = "--continue-on-collection-errors"
PASSES = "def test_passes():\n    pass\n"
SKIPS = "import pytest\n@pytest.mark.skipif(True, reason='no such tool')\ndef test_s():\n    pass\n"
SKIPS_INSIDE = "import pytest\ndef test_s():\n    pytest.skip('no such tool')\n"
MODULE_SKIPS = "import pytest\npytest.skip('no such tool', allow_module_level=True)\n"
EXPECTED_FAILURE = (
    "import pytest\n@pytest.mark.xfail(reason='known')\ndef test_x():\n    raise ValueError\n"
)


def run_pytest(folder: Path, sources: list[str], *options: str) -> subprocess.CompletedProcess[str]:
    for number, source in enumerate(sources):
        (folder / f"test_{number}.py").write_text(source)
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", *options]
    command += ["-p", "tests.conftest", "-c", "/dev/null", "--rootdir", str(folder), str(folder)]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)


def test_skip_fails_the_run_in_ci_with_the_reason(tmp_path: Path) -> None:
    run = run_pytest(tmp_path, [SKIPS, SKIPS_INSIDE, MODULE_SKIPS, PASSES], "--no-skips", GO_ON)
    assert run.returncode != 0
    summary = run.stdout.partition("short test summary")[2]
    for number in range(3):
        assert re.search(rf"test_{number}\.py.* - .*--no-skips forbids: .*no such tool", summary), (
            run.stdout
        )
    assert "test_3" not in summary


def test_elsewhere_a_skip_is_only_reported(tmp_path: Path) -> None:
    assert run_pytest(tmp_path, [PASSES + SKIPS]).returncode == 0


def test_passing_and_expected_failing_tests_are_unchanged(tmp_path: Path) -> None:
    assert run_pytest(tmp_path, [PASSES + EXPECTED_FAILURE], "--no-skips").returncode == 0
