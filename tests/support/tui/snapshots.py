"""Screens as SVG files: compared with those that are committed, written anew when asked for."""

import re
from pathlib import Path
from typing import Final

FOLDER: Final = Path(__file__).parents[2] / "tui" / "snapshots"
TERMINAL_ID: Final = re.compile(r"terminal-\d+-")
ACTUAL: Final = ".actual.svg"


def normalised(svg: str) -> str:
    """Rich names its styles and clips after a checksum of the whole: that is nobody's concern."""
    lines = TERMINAL_ID.sub("terminal-", svg).splitlines()
    return "\n".join(line.rstrip() for line in lines) + "\n"


def compare(svg: str, name: str, *, update: bool, folder: Path = FOLDER) -> str:
    """Empty when it is as committed; else what to do about it. The actual one is left beside."""
    actual, committed = normalised(svg), folder / f"{name}.svg"
    beside = folder / f"{name}{ACTUAL}"
    if beside.exists():  # the tree may be one that nobody can write to
        beside.unlink()
    if update:
        folder.mkdir(exist_ok=True)
        committed.write_text(actual, encoding="utf-8")
        return ""
    if committed.exists() and committed.read_text(encoding="utf-8") == actual:
        return ""
    beside.write_text(actual, encoding="utf-8")
    what = "differs from" if committed.exists() else "has no"
    return f"{name} {what} {committed}; look at {beside}, and take it with --update-screens"
