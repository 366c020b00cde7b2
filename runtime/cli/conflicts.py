"""Find other distributions that replace our packages, such as `robot` of Robot Framework.

Two distributions with a package of the same name are installed into the same folder, where files of
one replace those of the other. The RECORD of each distribution lists its files.
"""

import base64
import csv
import hashlib
import re
from pathlib import Path
from typing import Final

from runtime.cli.packages import APART, NAME, PACKAGES, ROOT, Conflict, displaced, shown

LISTED: Final = re.compile(rf"^({'|'.join(PACKAGES)})/", re.MULTILINE)
"""The line of a RECORD for a file in a package with one of our names."""


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
    from importlib import metadata  # slow to import, and needed by `doctor` only

    found: dict[Path, str] = {}
    for distribution in metadata.distributions():
        name = distribution.metadata["Name"]
        if name and name != NAME:
            for package in set(LISTED.findall(distribution.read_text("RECORD") or "")):
                folder = Path(str(distribution.locate_file(package))).resolve()
                found[folder] = f"{name} {distribution.version}"
    return found


def broken_files() -> dict[str, Path]:
    """Return for each of our packages the first file that is missing or was modified.

    A checkout has none: its installation lists only the location.
    """
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
    try:
        digest = hashlib.new(algorithm, file.read_bytes()).digest()
    except OSError:
        return ""
    return base64.urlsafe_b64encode(digest).rstrip(b"=").decode()
