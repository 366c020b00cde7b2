"""Check whether Python finds our packages, or others of the same names such as `robot`.

The executable loads this module by its file before it imports any of our packages. So this module
imports none of them, and nothing that takes long.
"""

import importlib.util
import os
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Final, NamedTuple

ROOT: Final = Path(__file__).resolve().parents[2]
NAME: Final = "sidestep"
PACKAGES: Final = (
    "runtime",
    "protocol",
    "robot",
    "firmware",
    "plant",
    "ground",
    "gateways",
    "vehicle_check",
    "study",
)
APART: Final = (
    f"install {NAME} in an environment of its own, with `python3 -m venv`, `pipx install` or "
    "`uvx --from`"
)


class Conflict(NamedTuple):
    """A package with the same name as one of ours.

    `wins`: Python finds the other package, or our files were replaced, so that this program fails.
    """

    what: str
    do: str
    wins: bool

    def __str__(self) -> str:
        return f"{self.what}: {self.do}"


def displaced(packages: Iterable[str] = PACKAGES) -> Iterator[Conflict]:
    """Yield a conflict for each package for which Python finds another one first."""
    for name in packages:
        place = place_of(name)
        if place is not None and place != ROOT / name:
            what = f"Python finds package `{name}` at {shown(place)}, not at {shown(ROOT / name)}"
            yield Conflict(what, way_out(place.parent), wins=True)


def place_of(package: str) -> Path | None:
    """Return the folder or file that `import package` would use, or None."""
    try:
        spec = importlib.util.find_spec(package)
    except (ImportError, ValueError):
        return None
    if spec is None:
        return None
    places = [*(spec.submodule_search_locations or ()), *([spec.origin] if spec.origin else ())]
    return Path(places[0]).resolve() if places else None


def way_out(folder: Path) -> str:
    """Return the remedy for a folder that precedes ours on the path."""
    on_path = os.environ.get("PYTHONPATH", "").split(os.pathsep)
    if folder in [Path(entry).resolve() for entry in on_path if entry]:
        return f"take {shown(folder)} out of PYTHONPATH"
    if sys.path[:1] in ([""], [str(folder)]) and folder == Path.cwd().resolve():
        return f"start {NAME} in another folder"
    return APART


def shown(path: Path) -> str:
    """Return a path without control characters, for a terminal."""
    return "".join(letter if letter.isprintable() else "?" for letter in str(path))
