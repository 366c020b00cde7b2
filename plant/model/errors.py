"""What is wrong with a world file: file, line, key, reason and fix, all of it in one go."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from runtime.toml_lines import Key


class Problem(NamedTuple):
    file: str
    line: int | None
    key: str
    reason: str
    fix: str

    def __str__(self) -> str:
        place = self.file if self.line is None else f"{self.file}:{self.line}"
        return f"{place}: {self.key}: {self.reason}; fix: {self.fix}"


class WorldError(Exception):
    """A world cannot be used; its text has one line per problem, in the order of the file."""

    exit_code = 2

    def __init__(self, problems: Sequence[Problem]) -> None:
        self.problems = tuple(sorted(problems, key=lambda problem: problem.line or 0))
        super().__init__("\n".join(str(problem) for problem in self.problems))


class Report:
    """Collects the problems of one file and finds the line of each."""

    def __init__(self, file: str, lines: Mapping[Key, int]) -> None:
        self._file = file
        self._lines = lines
        self.problems: list[Problem] = []

    def add(self, key: Key, reason: str, fix: str) -> None:
        self.problems.append(Problem(self._file, self.line(key), key_text(key), reason, fix))

    def line(self, key: Key) -> int:
        """The line of the key, or of the nearest table or list around it."""
        for length in range(len(key), 0, -1):
            if key[:length] in self._lines:
                return self._lines[key[:length]]
        return 1


def key_text(key: Key) -> str:
    """How a person names the key: `obstacle#2.circle_m.radius`, counted from 1."""
    text = ""
    for part in key:
        text += f"#{part + 1}" if isinstance(part, int) else f".{part}"
    return text.removeprefix(".")
