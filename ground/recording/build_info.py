"""Identify the build that records: its version, and the commit if it is known."""

import os
import subprocess
from importlib import metadata
from pathlib import Path
from typing import Final

from protocol.topics import DIALECT
from runtime.cli import compiled

ROOT: Final = Path(__file__).parents[2]
UNKNOWN: Final = "unknown"
GIT_TIMEOUT_S: Final = 10.0


def build() -> dict[str, str]:
    """Return version, commit and dialect for the header of a recording."""
    return {"version": version_of("sidestep"), "commit": commit(), "dialect": DIALECT}


def version_of(package: str) -> str:
    """Return the installed version of a package."""
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return UNKNOWN


def commit() -> str:
    """Return the commit of the checkout, else the one that was compiled, else "unknown".

    A `+` at its end means that tracked files have changes.
    """
    if not (ROOT / ".git").exists():
        return compiled.commit()
    head = git("rev-parse", "HEAD")
    changed = "+" if git("status", "--porcelain", "--untracked-files=no") else ""
    return f"{head}{changed}" if head else UNKNOWN


def git(*words: str) -> str | None:
    """Return the output of git, or None when git fails or is not installed."""
    try:
        run = subprocess.run(
            ["git", "-C", str(ROOT), *words],
            capture_output=True,
            text=True,
            timeout=GIT_TIMEOUT_S,
            check=True,
            env={**os.environ, "GIT_OPTIONAL_LOCKS": "0"},
        )
    except (OSError, subprocess.SubprocessError):
        return None
    return run.stdout.strip()
