"""Build a compiled installation of the checkout, as a user does."""

import os
import subprocess
import sys
from pathlib import Path
from typing import Final
from zipfile import ZipFile

ROOT: Final = Path(__file__).resolve().parents[2]
BUILD_TIMEOUT_S: Final = 540


def wheel_of(folder: Path, switch: str = "1") -> Path:
    """Build a wheel with the tools of this environment, compiled if `switch` is 1.

    Raises RuntimeError with the output of pip.
    """
    words = ("pip", "wheel", "--no-deps", "--no-build-isolation", "--no-index", "-w", str(folder))
    run = subprocess.run(
        [sys.executable, "-m", *words, str(ROOT)],
        env={**os.environ, "SIDESTEP_COMPILE": switch},
        capture_output=True,
        text=True,
        timeout=BUILD_TIMEOUT_S,
        check=False,
    )
    if run.returncode:
        raise RuntimeError(f"pip wheel failed:\n{run.stdout}{run.stderr}")
    return next(folder.glob("*.whl"))


def install_compiled(folder: Path) -> Path:
    """Build and unpack a compiled wheel; return the folder that belongs on the search path."""
    with ZipFile(wheel_of(folder / "wheels")) as wheel:
        wheel.extractall(folder / "installation")
    return folder / "installation"
