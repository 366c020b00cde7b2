"""A compiled installation, shared by all workers of a test run."""

import fcntl
import os
import subprocess
import sys
from pathlib import Path

import pytest

import hatch_build
from checks.built import ROOT, install_compiled


def installed(shared: Path) -> Path:
    """Return a folder with the compiled modules; skip the test where nothing can compile.

    The workers of a test run, which give the same folder, share one installation.
    """
    try:
        hatch_build.check_compiler()
    except SystemExit as refusal:
        pytest.skip(str(refusal))
    with (shared / "compiled.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        return install_compiled(shared / "compiled")


def run_python(
    folder: Path, *words: str, timeout_s: float = 240.0
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
