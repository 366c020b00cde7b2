"""Compare screens as SVG files with the committed ones, or write them again."""

import re
from pathlib import Path
from typing import Final

from runtime import files

FOLDER: Final = Path(__file__).parents[2] / "tui" / "snapshots"
TERMINAL_ID: Final = re.compile(r"terminal-\d+-")
ACTUAL: Final = ".actual.svg"


def normalised(svg: str) -> str:
    """Remove the checksum by which Rich names its styles and clips."""
    lines = TERMINAL_ID.sub("terminal-", svg).splitlines()
    return "\n".join(line.rstrip() for line in lines) + "\n"


def compare(svg: str, name: str, *, update: bool, folder: Path = FOLDER) -> str:
    """Return "" when the screen is as committed, else what to do.

    The actual screen is saved beside the committed one.
    """
    actual, committed = normalised(svg), folder / f"{name}.svg"
    beside = folder / f"{name}{ACTUAL}"
    if beside.exists():  # the tree may be read-only
        beside.unlink()
    if committed.exists() and committed.read_text(encoding="utf-8") == actual:
        return ""
    if update:
        folder.mkdir(exist_ok=True)
        files.replace(committed, actual)
        return ""
    beside.write_text(actual, encoding="utf-8")
    what = "differs from" if committed.exists() else "has no"
    return f'{name} {what} {committed}; look at {beside}, take it with make refresh ARGS="screens"'
