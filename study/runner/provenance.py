"""What a row was produced by: the code, the libraries and the machine."""

import os
import platform
import subprocess
import sys
from functools import cache
from hashlib import sha256
from importlib import metadata
from pathlib import Path
from typing import Final, NamedTuple

ROOT: Final = Path(__file__).parents[2]
DRIVEN_BY: Final = ("robot/**/*.py", "plant/**/*.py", "protocol/**/*.py", "runtime/**/*.py")
TRIED_BY: Final = (
    "runtime/**/*.toml",
    "study/trial/trial.py",
    "study/trial/core_loop.py",
    "study/trial/behaviour.py",
)
GIT_PATIENCE_S: Final = 10.0


class Code(NamedTuple):
    """`digest` is over the files that a trial runs; two commits may have the same."""

    commit: str
    dirty: bool
    version: str
    digest: str


class Machine(NamedTuple):
    """Names as in `study.runner.rows.Row`."""

    python: str
    numpy: str
    pymunk: str
    platform: str
    machine: str


@cache
def code() -> Code:
    """Commit "unknown" where it does not run from a checkout, as when it was installed."""
    digest = code_digest(ROOT)
    if _git("ls-files", "--error-unmatch", "study/trial/trial.py") is None:
        return Code("unknown", False, _version("sidestep"), digest)
    commit = _git("rev-parse", "HEAD") or "unknown"
    dirty = bool(_git("status", "--porcelain", "--untracked-files=no"))
    return Code(commit, dirty, _version("sidestep"), digest)


@cache
def machine() -> Machine:
    return Machine(
        python=".".join(map(str, sys.version_info[:3])),
        numpy=_version("numpy"),
        pymunk=_version("pymunk"),
        platform=platform.platform(),
        machine=_processor(),
    )


def code_digest(root: Path) -> str:
    """SHA-256 over the files that decide how a trial goes, with their places."""
    digest = sha256()
    for pattern in (*DRIVEN_BY, *TRIED_BY):
        for file in sorted(root.glob(pattern)):
            digest.update(f"{file.relative_to(root)}\0".encode())
            digest.update(file.read_bytes())
    return digest.hexdigest()


def _git(*words: str) -> str | None:
    """What git answers; None when it does not know, or is not there."""
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


def _version(package: str) -> str:
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return "unknown"


def _processor() -> str:
    """The model as the kernel names it."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    models = (line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    return next(models, "") or platform.processor() or platform.machine() or "unknown"
