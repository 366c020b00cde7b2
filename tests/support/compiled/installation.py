"""A compiled installation, built once for all workers of a test run.

In the environment of `make setup` it is a copy of the one that `make study` uses.
"""

import fcntl
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

import hatch_build
from benchmarks.compiled.wheel import ROOT, install_compiled

DONE = "built"
COMPILED = ROOT / "build" / "compiled"


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Hold a lock, so that another worker waits for the build instead of building, too."""
    folder.mkdir(exist_ok=True)
    with (folder / "lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        yield


def built(shared: Path) -> Path:
    """Return the folder of a compiled installation; skip the test where nothing can compile."""
    try:
        hatch_build.check_compiler()
    except SystemExit as refusal:
        pytest.skip(str(refusal))
    folder = shared / "compiled"
    with locked(folder):
        if not (folder / DONE).exists():
            if Path(sys.prefix) == ROOT / ".venv":
                subprocess.run(("make", "--silent", "compiled"), cwd=ROOT, check=True)
                shutil.copytree(COMPILED, folder / "installation")
            else:
                install_compiled(folder)
            (folder / DONE).touch()
    return folder / "installation"


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
