"""Check whether Python finds our packages, or others such as the `robot` of Robot Framework.

Two distributions with a package of the same name are installed into the same folder, where files of
one replace those of the other. The RECORD of each distribution lists its files.

The executable loads this module by its file before it imports any of our packages. So this module
imports none of them, and what takes long only where it is needed.
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
    "sidestep",
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


def conflicts() -> list[Conflict]:
    """Return all conflicts, first those that keep this program from working."""
    found = list(displaced())
    owners = owners_of_folders()
    for name, file in broken_files().items():
        owner = owners.pop(ROOT / name, "")
        if not file.exists():
            what = f"file {shown(file)} of package `{name}` is missing"
            found.append(Conflict(what, f"install {NAME} again", wins=True))
        elif owner:
            what = f"package `{name}`: {owner} has replaced {shown(file)}"
            found.append(Conflict(what, APART, wins=True))
    for folder, owner in owners.items():
        if folder.parent == ROOT:
            what = f"package `{folder.name}`: {owner} has files in {shown(folder)}, too"
            found.append(Conflict(what, APART, wins=False))
    return found


def owners_of_folders() -> dict[Path, str]:
    """Return the folders with our names that other distributions have files in, and their names.

    A distribution that does not list its files is not found.
    """
    import re
    from importlib import metadata

    listed = re.compile(rf"^({'|'.join(PACKAGES)})/", re.MULTILINE)  # a file in a package
    found: dict[Path, str] = {}
    for distribution in metadata.distributions():
        name = distribution.metadata["Name"]
        if name and name != NAME:
            for package in set(listed.findall(distribution.read_text("RECORD") or "")):
                folder = Path(str(distribution.locate_file(package))).resolve()
                found[folder] = f"{name} {distribution.version}"
    return found


def broken_files() -> dict[str, Path]:
    """Return for each of our packages the first file that is missing or was modified.

    A checkout has none: its installation lists only the location.
    """
    import csv
    from importlib import metadata

    try:
        record = metadata.distribution(NAME).read_text("RECORD") or ""
    except metadata.PackageNotFoundError:
        return {}
    found: dict[str, Path] = {}
    for file, recorded, *_ in csv.reader(record.splitlines()):
        package = file.partition("/")[0]
        if package not in PACKAGES or package in found or not recorded:
            continue
        algorithm, _, digest = recorded.partition("=")
        if digest_of(ROOT / file, algorithm) != digest:
            found[package] = ROOT / file
    return found


def digest_of(file: Path, algorithm: str) -> str:
    """Return the digest in the notation of RECORD; empty for an unreadable file."""
    import base64
    import hashlib

    try:
        digest = hashlib.new(algorithm, file.read_bytes()).digest()
    except OSError:
        return ""
    return base64.urlsafe_b64encode(digest).rstrip(b"=").decode()
