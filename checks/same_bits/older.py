"""An older commit with the trials of this one, as a control."""

import shutil
import subprocess
import tarfile
from io import BytesIO
from pathlib import Path
from typing import Final

from checks.same_bits.variants import ROOT

BROUGHT: Final = (
    "checks/same_bits/__init__.py",
    "checks/same_bits/trials.py",
    "plant/model/draws.py",
)
"""Files that the trials need and an older commit lacks. Draws only choose the trials there."""


def unpack(commit: str, folder: Path) -> Path:
    """Unpack a commit into a folder with what the trials need; return the folder.

    Raises subprocess.CalledProcessError for an unknown commit.
    """
    archive = subprocess.run(["git", "archive", commit], cwd=ROOT, capture_output=True, check=True)
    shutil.rmtree(folder, ignore_errors=True)
    with tarfile.open(fileobj=BytesIO(archive.stdout)) as tar:
        # An attribute, not an argument: Python before 3.11.4, as in Debian 12, has no filters.
        tar.extraction_filter = getattr(tarfile, "data_filter", None)
        tar.extractall(folder)
    for name in BROUGHT:
        target = folder / name
        target.parent.mkdir(parents=True, exist_ok=True)
        if not target.exists():
            shutil.copyfile(ROOT / name, target)
    return folder
