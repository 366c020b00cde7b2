"""Which build recorded: its version, and the commit where it runs from a checkout."""

import os
import subprocess
from importlib import metadata
from pathlib import Path
from typing import Final

from protocol.topics import DIALECT

ROOT: Final = Path(__file__).parents[2]
UNKNOWN: Final = "unknown"
GIT_PATIENCE_S: Final = 10.0


def build() -> dict[str, str]:
    """Texts for the head of a recording."""
    return {"version": version_of("sidestep"), "commit": _commit(), "dialect": DIALECT}


def version_of(package: str) -> str:
    """Return the installed version of a package."""
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return UNKNOWN


def _commit() -> str:
    """A `+` at its end: something that git knows has been changed since."""
    if not (ROOT / ".git").exists():
        return UNKNOWN
    commit = git("rev-parse", "HEAD")
    changed = "+" if git("status", "--porcelain", "--untracked-files=no") else ""
    return f"{commit}{changed}" if commit else UNKNOWN


def git(*words: str) -> str | None:
    """Return what git answers; None when it does not know, or is not there."""
    try:
        run = subprocess.run(
            ["git", "-C", str(ROOT), *words],
            capture_output=True,
            text=True,
            timeout=GIT_PATIENCE_S,
            check=True,
            env={**os.environ, "GIT_OPTIONAL_LOCKS": "0"},
        )
    except (OSError, subprocess.SubprocessError):
        return None
    return run.stdout.strip()
