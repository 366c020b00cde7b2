"""List the problems of a mission file: file, line, key or item, reason and fix."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from runtime.errors import UserError
from runtime.toml_reader import Key


class Problem(NamedTuple):
    """A problem; `where` is the key or the number of the item."""

    where: str
    reason: str
    fix: str
    line: int | None = None


class MissionError(UserError):
    """A mission that cannot be used; the text has one line per problem."""

    def __init__(self, file: str, problems: Sequence[Problem]) -> None:
        self.problems = tuple(sorted(problems, key=lambda problem: problem.line or 0))
        super().__init__("\n".join(problem_line(file, problem) for problem in self.problems))


def problem_line(file: str, problem: Problem) -> str:
    """Format a problem as one line."""
    place = file if problem.line is None else f"{file}:{problem.line}"
    where = f"{problem.where}: " if problem.where else ""
    fix = f"; {problem.fix}" if problem.fix else ""
    return f"{place}: {where}{problem.reason}{fix}"


def line_of(lines: Mapping[Key, int], key: Key) -> int | None:
    """Return the line of a key, or of the nearest table around it."""
    while key and key not in lines:
        key = key[:-1]
    return lines.get(key)
