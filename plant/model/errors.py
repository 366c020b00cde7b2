"""Problems of a world file or an imported file: file, line, key, reason and fix.

All problems of a file are collected.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from runtime.errors import UserError
from runtime.files import UnusableFileError, bytes_in, decoded
from runtime.toml_reader import Key


class WorldProblem(NamedTuple):
    """One problem of a world file."""

    file: str
    line: int | None
    key: str
    reason: str
    fix: str

    def __str__(self) -> str:
        place = self.file if self.line is None else f"{self.file}:{self.line}"
        return f"{place}: {self.key}: {self.reason}; fix: {self.fix}"


class WorldError(UserError):
    """A world cannot be used; the text has one line per problem, in the order of the file."""

    def __init__(self, problems: Sequence[WorldProblem]) -> None:
        self.problems = tuple(sorted(problems, key=lambda problem: problem.line or 0))
        super().__init__("\n".join(str(problem) for problem in self.problems))


class WorldReport:
    """Collect the problems of one file and find the line of each."""

    def __init__(self, file: str, lines: Mapping[Key, int]) -> None:
        self._file = file
        self._lines = lines
        self.problems: list[WorldProblem] = []

    def add(self, key: Key, reason: str, fix: str) -> None:
        """Add a problem of a key."""
        self.problems.append(WorldProblem(self._file, self.line(key), key_text(key), reason, fix))

    def line(self, key: Key) -> int:
        """Return the line of a key, or of the nearest table or list around it."""
        for length in range(len(key), 0, -1):
            if key[:length] in self._lines:
                return self._lines[key[:length]]
        return 1


def key_text(key: Key) -> str:
    """Return a key as text: `obstacle#2.circle_m.radius`, counted from 1."""
    text = ""
    for part in key:
        text += f"#{part + 1}" if isinstance(part, int) else f".{part}"
    return text.removeprefix(".")


def refuse(file: str, key: str, reason: str, fix: str, line: int | None = None) -> WorldError:
    """Return the WorldError to be raised."""
    return WorldError([WorldProblem(file, line, key, reason, fix)])


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
        return decoded(data)
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        fix = "is it the right file? save it as UTF-8"
        raise refuse(str(path), "file", "not UTF-8 text", fix, line) from None
