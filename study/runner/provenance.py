"""Provenance of a row: code, libraries and machine."""

import platform
import sys
from functools import cache
from hashlib import sha256
from pathlib import Path
from typing import Final, NamedTuple

from ground.recording.build_info import commit, version_of
from runtime.cli.compiled import is_compiled

ROOT: Final = Path(__file__).parents[2]
DRIVE_SOURCES: Final = ("robot/**/*.py", "plant/**/*.py", "protocol/**/*.py", "runtime/**/*.py")
TRIAL_SOURCES: Final = (
    "runtime/**/*.toml",
    "study/trial/trial.py",
    "study/trial/core_loop.py",
    "study/trial/drive.py",
    "study/trial/behaviour.py",
)


class CodeVersion(NamedTuple):
    """The code that runs; `digest` covers the files that a trial runs.

    Two commits may have the same digest.
    """

    commit: str
    dirty: bool
    version: str
    digest: str


class MachineInfo(NamedTuple):
    """Libraries and machine, under the names in `study.runner.rows.TrialRow`."""

    python: str
    numpy: str
    pymunk: str
    platform: str
    machine: str


@cache
def code() -> CodeVersion:
    """Return the running code; see `build_info.commit` for where the commit is known."""
    known = commit()
    return CodeVersion(
        commit=known.removesuffix("+"),
        dirty=known.endswith("+"),
        version=version_of("sidestep"),
        digest=code_digest(ROOT),
    )


@cache
def machine() -> MachineInfo:
    """Return libraries and machine of this process."""
    return MachineInfo(
        python=".".join(map(str, sys.version_info[:3])) + (", compiled" if is_compiled() else ""),
        numpy=version_of("numpy"),
        pymunk=version_of("pymunk"),
        platform=platform.platform(),
        machine=_processor(),
    )


def code_digest(root: Path) -> str:
    """Return the SHA-256 of the files that determine a trial, with their paths."""
    digest = sha256()
    for pattern in (*DRIVE_SOURCES, *TRIAL_SOURCES):
        for file in sorted(root.glob(pattern)):
            digest.update(f"{file.relative_to(root)}\0".encode())
            digest.update(file.read_bytes())
    return digest.hexdigest()


def _processor() -> str:
    """Return the processor model as the kernel names it."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    models = (line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    return next(models, "") or platform.processor() or platform.machine() or "unknown"
