"""A compiled installation, built as a user builds it, once for all workers of a test run."""

import fcntl
import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from zipfile import ZipFile

import pytest

import hatch_build

ROOT = Path(__file__).parents[3]
BUILD_TIMEOUT_S = 280


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Hold a lock, so that another worker waits for the build instead of building, too."""
    with (folder / "compiled.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        yield


def built(shared: Path) -> Path:
    """Return the folder of a compiled installation; skip the test where nothing can compile."""
    try:
        hatch_build.check_compiler()
    except SystemExit as refusal:
        pytest.skip(str(refusal))
    folder = shared / "compiled"
    with locked(shared):
        if not folder.exists():
            wheels = shared / "wheels"
            run = build_wheel(wheels)
            assert run.returncode == 0, run.stdout + run.stderr
            with ZipFile(next(wheels.glob("*.whl"))) as wheel:
                wheel.extractall(folder)
    return folder


def build_wheel(into: Path, switch: str = "1") -> "subprocess.CompletedProcess[str]":
    """Build a wheel of the checkout, with the tools of this environment."""
    words = ("pip", "wheel", "--no-deps", "--no-build-isolation", "--no-index", "-w", str(into))
    return subprocess.run(
        [sys.executable, "-m", *words, str(ROOT)],
        env={**os.environ, hatch_build.SWITCH: switch},
        capture_output=True,
        text=True,
        timeout=BUILD_TIMEOUT_S,
        check=False,
    )


def run_python(
    folder: Path, *words: str, timeout_s: float = 120
) -> "subprocess.CompletedProcess[str]":
    """Run Python with the packages of an installation; the tests come from the checkout."""
    return subprocess.run(
        [sys.executable, "-P", *words],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": os.pathsep.join([str(folder), str(ROOT)])},
        capture_output=True,
        text=True,
        timeout=timeout_s,
        check=False,
    )
