"""Find the compiled modules of this installation, and compare them with their sources.

`SIDESTEP_COMPILE=1 pip install .` puts compiled modules beside their sources, with a list of both
(see `hatch_build`). Python prefers a compiled module even if its source has changed since. The
executable loads this module by its file, so it imports nothing of ours.
"""

import json
from collections.abc import Iterator
from hashlib import sha256
from importlib.machinery import EXTENSION_SUFFIXES
from os import walk
from pathlib import Path
from typing import Any, Final

ROOT: Final = Path(__file__).resolve().parents[2]
LIST: Final = "runtime/compiled.json"
PACKAGES: Final = ("runtime", "robot", "plant", "study")
REMEDY: Final = (
    "install again: with SIDESTEP_COMPILE=1 compiled, without it in pure Python "
    "(pip install --force-reinstall --no-deps ...)"
)


def is_compiled(root: Path = ROOT) -> bool:
    """Return whether this is a compiled installation."""
    return (root / LIST).exists()


def complaint(root: Path = ROOT) -> str:
    """Return why the compiled modules must not be used; empty if they match, or if none exist."""
    return next(complaints(root), "")


def complaints(root: Path = ROOT) -> Iterator[str]:
    """Yield a text about each compiled module without its source, and about each changed source."""
    listed = sources(root)
    found = dict(compiled_modules(root))
    for name in sorted(found.keys() - listed.keys()):
        yield (
            f"{name} is compiled here, but {LIST} does not list it, so it may be older than its "
            f"source: delete {found[name]}"
        )
    for name, digest in listed.items():
        source = root / name
        if name not in found:
            yield f"the compiled module of {name} is missing or for another Python: {REMEDY}"
        elif not source.exists() or sha256(source.read_bytes()).hexdigest() != digest:
            yield f"{name} has changed since it was compiled: {REMEDY}"


def sources(root: Path) -> dict[str, str]:
    """Return the SHA-256 of each source at the time it was compiled, by its path."""
    listed: dict[str, str] = _list(root).get("sources", {})
    return listed


def commit(root: Path = ROOT) -> str:
    """Return the commit that was compiled, with a + if files had changes, or "unknown"."""
    return str(_list(root).get("commit", "unknown"))


def _list(root: Path) -> dict[str, Any]:
    try:
        text = (root / LIST).read_text(encoding="utf-8")
    except FileNotFoundError:
        return {}
    listed: dict[str, Any] = json.loads(text)
    return listed


def compiled_modules(root: Path) -> Iterator[tuple[str, str]]:
    """Yield each source that Python does not read, and the compiled module that precedes it."""
    for package in PACKAGES:
        for folder, _, files in walk(root / package):
            for file in files:
                name, dot, suffix = file.partition(".")
                if dot + suffix in EXTENSION_SUFFIXES:
                    place = Path(folder).relative_to(root).as_posix()
                    yield f"{place}/{name}.py", f"{place}/{file}"
