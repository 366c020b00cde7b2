"""Problems of a world file: file, line, key, reason and fix; all problems are collected."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from runtime.toml_reader import Key


class Problem(NamedTuple):
    """One problem of a world file."""

    file: str
    line: int | None
    key: str
    reason: str
    fix: str

    def __str__(self) -> str:
        place = self.file if self.line is None else f"{self.file}:{self.line}"
        return f"{place}: {self.key}: {self.reason}; fix: {self.fix}"


class WorldError(Exception):
    """A world cannot be used; the text has one line per problem, in the order of the file."""

    exit_code = 2

    def __init__(self, problems: Sequence[Problem]) -> None:
        self.problems = tuple(sorted(problems, key=lambda problem: problem.line or 0))
        super().__init__("\n".join(str(problem) for problem in self.problems))


class Report:
    """Collect the problems of one file and find the line of each."""

    def __init__(self, file: str, lines: Mapping[Key, int]) -> None:
        self._file = file
        self._lines = lines
        self.problems: list[Problem] = []

    def add(self, key: Key, reason: str, fix: str) -> None:
        """Add a problem of a key."""
        self.problems.append(Problem(self._file, self.line(key), key_text(key), reason, fix))

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
