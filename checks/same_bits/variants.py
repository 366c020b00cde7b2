"""Environments that compute trials: environment variables, Pythons, libraries and older commits.

The lowest supported libraries are those named in pyproject.toml, the newest those of the package
index. Each pair of a Python and a set of libraries has a virtual environment of its own. An older
commit with the trials of this one is a control.
"""

import os
import re
import shutil
import subprocess
import sys
import tarfile
import tomllib
from collections.abc import Mapping
from io import BytesIO
from pathlib import Path
from types import MappingProxyType
from typing import Final, NamedTuple

from checks.built import BuildError, install_compiled

ROOT: Final = Path(__file__).resolve().parents[2]
LIBRARIES: Final = ("numpy", "pymunk", "msgspec", "fastcrc")
"""Dependencies of the project that a trial imports."""

PYTHONS: Final = ("python3.11", "python3.12", "python3.13")

TUNABLES: Final = "GLIBC_TUNABLES"
PLAIN_C: Final = "glibc.cpu.hwcaps=-FMA,-FMA4,-AVX2,-AVX2_Usable,-FMA_Usable"
PLAINER_C: Final = f"{PLAIN_C},-AVX,-SSE4_1,-SSE4_2,-AVX512F,-AVX512VL,-AVX512DQ,-AVX512BW"
NO_FEATURES: Final = {"NPY_DISABLE_CPU_FEATURES": "X86_V4 X86_V3"}
NO_FEATURES_OF_2_0: Final = {
    "NPY_DISABLE_CPU_FEATURES": "AVX2 FMA3 AVX512F AVX512CD AVX512_SKX AVX512_CLX AVX512_CNL"
}
"""The names of the features before numpy 2.4."""


class Variant(NamedTuple):
    """A name, the Python that runs the trials, and its additional environment variables."""

    name: str
    python: str
    environment: Mapping[str, str] = MappingProxyType({})


def of_processors(python: str) -> list[Variant]:
    """Return variants of a Python in which libraries do not use some processor features."""
    return [
        Variant("C library without AVX2 and FMA", python, {TUNABLES: PLAIN_C}),
        Variant("C library without AVX, AVX-512 and SSE4", python, {TUNABLES: PLAINER_C}),
        Variant("numpy without AVX2, FMA3 and AVX-512", python, _numpy_plain(python)),
        Variant("BLAS for an old processor", python, {"OPENBLAS_CORETYPE": "Prescott"}),
        Variant("BLAS for Haswell", python, {"OPENBLAS_CORETYPE": "Haswell"}),
        Variant(
            "all of these, and another hash of strings",
            python,
            {
                TUNABLES: PLAINER_C,
                **_numpy_plain(python),
                "OPENBLAS_CORETYPE": "Prescott",
                "PYTHONHASHSEED": "4711",
            },
        ),
    ]


def _numpy_plain(python: str) -> dict[str, str]:
    """Return the variable that switches numpy's instructions off; a wrong name is an error."""
    code = "import numpy; numpy.zeros(1)"
    ran = subprocess.run(
        [python, "-W", "error", "-c", code],
        env={**os.environ, **NO_FEATURES},
        capture_output=True,
        check=False,
    )
    return NO_FEATURES_OF_2_0 if ran.returncode else NO_FEATURES


def of_libraries(folder: Path) -> list[Variant]:
    """Return every Python found, with its lowest and with its newest available libraries."""
    variants = []
    for name in PYTHONS:
        python = _of_pyenv(name) or shutil.which(name)
        for kind in ("lowest", "newest"):
            if python is None:
                print(f"{name}: not found", file=sys.stderr)
            elif made := _environment(python, folder / f"{name}-{kind}", kind == "lowest"):
                variants.append(Variant(f"{name}, {kind} libraries: {_libraries(made)}", made))
            else:
                print(f"{name}: its {kind} libraries cannot be installed", file=sys.stderr)
    return variants


def compiled(folder: Path) -> Variant:
    """Return this Python with the modules that mypyc compiles; raise RuntimeError without them.

    The folder goes before the checkout on the search path.
    """
    try:
        install_compiled(folder)
    except BuildError as error:
        raise RuntimeError(f"cannot compile: {error}") from None
    return Variant("compiled modules", sys.executable, {"PYTHONPATH": f"{folder}:{ROOT}"})


def requirements(lowest: bool) -> list[str]:
    """Return the requirements of a trial for pip."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    found = []
    for requirement in project["dependencies"]:
        name, _, version = requirement.partition(">=")
        if name in LIBRARIES:
            found.append(f"{name}=={version}.*" if lowest else name)
    return found


def _of_pyenv(name: str) -> str | None:
    """Return a Python of that name installed by pyenv, the newest."""
    folders = Path(os.environ.get("PYENV_ROOT", Path.home() / ".pyenv")).glob("versions/*/bin")
    found = [folder / name for folder in folders if (folder / name).exists()]
    newest = max(found, key=lambda path: _numbers(path.parts[-3]), default=None)
    return None if newest is None else str(newest)


def _numbers(version: str) -> list[int]:
    return [int(number) for number in re.findall(r"\d+", version)]


def _environment(python: str, folder: Path, lowest: bool) -> str | None:
    """Create a virtual environment; return its Python, None if a library is not available."""
    made = folder / "bin" / "python"
    wanted = requirements(lowest)
    ready = folder / "ready"
    if not ready.exists() or ready.read_text("utf-8") != "\n".join(wanted):
        steps = (
            [python, "-m", "venv", "--clear", str(folder)],
            [str(made), "-m", "pip", "install", "-q", "--only-binary=:all:", *wanted],
        )
        if any(subprocess.run(step, capture_output=True, check=False).returncode for step in steps):
            return None
        ready.write_text("\n".join(wanted), "utf-8")
    return str(made)


def _libraries(python: str) -> str:
    code = (
        "from importlib.metadata import version\n"
        f"print(', '.join(f'{{one}} {{version(one)}}' for one in {LIBRARIES[:2]!r}))"
    )
    return subprocess.run(
        [python, "-c", code], capture_output=True, text=True, check=True
    ).stdout.strip()


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
