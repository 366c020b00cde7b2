"""In CI a test that could not run has not passed."""

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PASSES = "def test_passes():\n    pass\n"
SKIPS = "import pytest\n@pytest.mark.skipif(True, reason='no such tool')\ndef test_s():\n    pass\n"
SKIPS_INSIDE = "import pytest\ndef test_s():\n    pytest.skip('no such tool')\n"
MODULE_SKIPS = "import pytest\npytest.skip('no such tool', allow_module_level=True)\n"
EXPECTED_FAILURE = (
    "import pytest\n@pytest.mark.xfail(reason='known')\ndef test_x():\n    raise ValueError\n"
)


def run_pytest(folder: Path, source: str, *options: str) -> subprocess.CompletedProcess[str]:
    (folder / "test_one.py").write_text(source)
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", *options]
    command += ["-p", "tests.conftest", "-c", "/dev/null", "--rootdir", str(folder), str(folder)]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)


@pytest.mark.parametrize("source", [SKIPS, SKIPS_INSIDE, MODULE_SKIPS])
def test_a_skip_fails_the_run_in_ci_and_says_why(tmp_path: Path, source: str) -> None:
    run = run_pytest(tmp_path, source, "--no-skips")
    assert run.returncode != 0
    assert "--no-skips forbids: " in run.stdout
    assert "no such tool" in run.stdout


def test_elsewhere_a_skip_is_only_reported(tmp_path: Path) -> None:
    assert run_pytest(tmp_path, PASSES + SKIPS).returncode == 0


def test_what_passes_and_what_is_known_to_fail_is_not_touched(tmp_path: Path) -> None:
    assert run_pytest(tmp_path, PASSES + EXPECTED_FAILURE, "--no-skips").returncode == 0
