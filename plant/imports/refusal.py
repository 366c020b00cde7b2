"""Errors of importers, in the form of world files: file, line, key and fix."""

from pathlib import Path

from plant.model.errors import Problem, WorldError
from runtime.regular_file import UnusableFileError, bytes_in


def refuse(file: str, key: str, reason: str, fix: str, line: int | None = None) -> WorldError:
    """Return the WorldError to be raised."""
    return WorldError([Problem(file, line, key, reason, fix)])


def read_bytes(path: Path, most_bytes: int) -> bytes:
    """Return a file's content; WorldError if it is unreadable or too large."""
    file = str(path)
    try:
        return bytes_in(path, most_bytes)
    except UnusableFileError as error:
        fix = "is it the right file? give a regular one, cut to size"
        raise refuse(file, "file", str(error), fix) from None
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        fix = "give a file that can be read"
        raise refuse(file, "file", f"cannot be read: {reason}", fix) from None


def read_text(path: Path, most_bytes: int) -> str:
    """Return a file's text with newlines as line ends; WorldError as for `read_bytes`."""
    data = read_bytes(path, most_bytes)
    try:
        return data.decode("utf-8-sig").replace("\r\n", "\n")
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        fix = "is it the right file? save it as UTF-8"
        raise refuse(str(path), "file", "not UTF-8 text", fix, line) from None
