"""The parts of a run: a recorder begins a new pair of files every so often.

The first pair has the name of the run; the later ones add `.part002` and so on. Whoever names one
of them means the run. Retention may have deleted the oldest.
"""

import re
from pathlib import Path
from typing import Final

from protocol.topic import NAME

NAMED: Final = re.compile(
    rf"(?P<run>\d{{8}}T\d{{6}}Z-(?P<robot>{NAME})(\.\d{{1,3}})?)(\.part(?P<number>\d{{3,6}}))?\Z"
)
SUFFIXES: Final = (".mcap", ".tlog")
PART_BYTES: Final = 100 * 10**6
PART_S: Final = 3600.0
"""Size of both files, or age, at which a part ends."""


def run_of(path: Path) -> Path:
    """Return the path of the run's files without suffix, by the path of one of them."""
    named = NAMED.match(path.stem)
    return path.with_name(named["run"] if named else path.stem)


def number_of(path: Path) -> int:
    """Return the number of a part, from 1."""
    named = NAMED.match(path.stem)
    return int((named and named["number"]) or 1)


def part_of(path: Path, number: int) -> Path:
    """Return the path of another part of the same run and kind."""
    ending = "" if number == 1 else f".part{number:03}"
    return path.with_name(f"{run_of(path).name}{ending}{path.suffix}")


def parts_of(path: Path) -> list[Path]:
    """Return the parts of a run that exist, in order, of the same kind; else the path itself."""
    if NAMED.match(path.stem) is None:
        return [path]
    run = run_of(path)
    found = [
        part
        for part in path.parent.glob(f"{run.name}.*")
        if part.suffix == path.suffix and NAMED.match(part.stem) and run_of(part) == run
    ]
    return sorted(found, key=number_of) or [path]


def files_of(path: Path) -> list[Path]:
    """Return all files of a run that exist."""
    paths = [part for suffix in SUFFIXES for part in parts_of(path.with_suffix(suffix))]
    return [part for part in paths if part.is_file()]
