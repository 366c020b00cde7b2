"""Read the commands on a page of the documentation, and compare or renew their output.

A block of the language `console` has commands behind `$ ` and the output of each below it. A block
with a title is a file that is written first. A comment before a block changes how it is run:

    <!-- console: exit 1 -->           the commands end with this exit code, instead of 0
    <!-- console: exact -->            numbers must be equal; otherwise any number matches a number
    <!-- console: background -->       start it, wait until it has printed the lines, go on
    <!-- console: until -->            repeat it until it prints the lines
    <!-- console: stop -->             alone: end the processes in the background
    <!-- console: run by FILE -->      not run here; the named file of the checkout runs it

In expected output `...` stands for any text, and alone in a line for any lines. Runs of spaces are
equal, and so are `1 try` and `2 tries`.
"""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

FENCE: Final = re.compile(r"^(?P<indent> *)```(?P<language>\w*)(?: title=\"(?P<title>[^\"]+)\")?$")
DIRECTIVE: Final = re.compile(r"^ *<!-- console: (?P<words>.+?) -->$")
NUMBER: Final = re.compile(r"[-+]?\d+(?:[.,]\d+)*(?:e[-+]?\d+)?")
PROMPT: Final = "$ "
CONTINUED: Final = "\\"
ANYTHING: Final = "..."
TRIES: Final = ("try", "tries")
"""Their number may be another one."""
REPLACED: Final = 2
SHIFTED: Final = 3
"""Costs of a changed line, and of a missing or additional one, when output is renewed."""


@dataclass(frozen=True, slots=True)
class File:
    """A file that the page asks the reader to save."""

    name: str
    text: str


@dataclass(frozen=True, slots=True)
class Command:
    """A command line, the output that the page shows, and how to run it."""

    line: int
    words: str
    output: tuple[str, ...]
    directive: str = ""

    @property
    def exit_code(self) -> int:
        """The expected exit code."""
        kind, _, code = self.directive.partition(" ")
        return int(code) if kind == "exit" else 0

    @property
    def runner(self) -> str | None:
        """The file that runs this command instead, or None."""
        before, found, file = self.directive.partition("run by ")
        return file if found and not before else None

    @property
    def is_exact(self) -> bool:
        """Return whether numbers must be equal."""
        return self.directive == "exact"


@dataclass(frozen=True, slots=True)
class Stop:
    """An order to end the processes in the background."""


Step = File | Command | Stop


def steps_of(page: Path) -> list[Step]:
    """Return what a page asks the reader to do, in order."""
    return list(steps(page.read_text(encoding="utf-8").splitlines()))


def steps(lines: Sequence[str]) -> Iterator[Step]:
    """Yield the files and commands of a page."""
    directive, number = "", 0
    while number < len(lines):
        if found := DIRECTIVE.match(lines[number]):
            directive = found["words"]
            if directive == "stop":
                directive = ""
                yield Stop()
        elif fence := FENCE.match(lines[number]):
            indent = len(fence["indent"])
            body = []
            for line in lines[number + 1 :]:
                if line[indent:] == "```":
                    break
                body.append(line[indent:])
            if fence["title"] is not None:
                yield File(fence["title"], "\n".join(body) + "\n")
            elif fence["language"] == "console":
                yield from commands(body, number + 2, directive)
            directive = ""
            number += len(body) + 1
        number += 1


def commands(body: Sequence[str], first_line: int, directive: str) -> Iterator[Command]:
    """Yield the commands of one block."""
    starts = [index for index, line in enumerate(body) if line.startswith(PROMPT)]
    for start, end in zip(starts, [*starts[1:], len(body)], strict=True):
        words, index = body[start].removeprefix(PROMPT), start
        while words.endswith(CONTINUED) and index + 1 < end:
            index += 1
            words = words.removesuffix(CONTINUED) + body[index].strip()
        yield Command(first_line + start, words, tuple(body[index + 1 : end]), directive)


def pattern_of(line: str, *, is_exact: bool = False) -> str:
    """Return the regular expression of one expected line."""
    parts = []
    for part in re.split(r"(\.\.\.|\s+)", line.strip()):
        if part == ANYTHING:
            parts.append(".*")
        elif part.isspace():
            parts.append(r"\s+")
        elif is_exact:
            parts.append(re.escape(part))
        elif part in TRIES:
            parts.append(f"(?:{'|'.join(TRIES)})")
        else:
            parts.append(re.sub(r"\0", lambda _: NUMBER.pattern, re.escape(NUMBER.sub("\0", part))))
    return "".join(parts)


def matches(expected: Sequence[str], printed: Sequence[str], *, is_exact: bool = False) -> bool:
    """Return whether the printed lines are the expected ones; blank lines do not count."""
    wanted = [line for line in expected if line.strip()]
    found = [line.strip() for line in printed if line.strip()]
    whole = "".join(
        r"(?:.*\n)*" if line.strip() == ANYTHING else pattern_of(line, is_exact=is_exact) + r"\n"
        for line in wanted
    )
    return re.fullmatch(whole, "".join(f"{line}\n" for line in found)) is not None


def renewed(
    expected: Sequence[str], printed: Sequence[str], *, is_exact: bool = False
) -> list[str]:
    """Return lines that match the printed ones; expected lines stay wherever they match.

    A number that may differ and a line `...` therefore stay, and only what has changed differs.
    """
    if not any(line.strip() for line in expected):
        return [line.rstrip() for line in printed]
    found = [line.rstrip() for line in printed if line.strip()]
    # rest[j]: how the lines from here on become the printed ones from j on: the cost, the lines.
    rest = [(SHIFTED * (len(found) - j), tuple(found[j:])) for j in range(len(found) + 1)]
    for line in reversed(expected):
        pattern = re.compile(pattern_of(line, is_exact=is_exact))
        is_any = line.strip() == ANYTHING
        if is_any or not line.strip():
            here = [(cost, (line, *lines)) for cost, lines in rest]
        else:
            here = [(cost + SHIFTED, lines) for cost, lines in rest]
        for j in reversed(range(len(found) if line.strip() else 0)):
            (cost, lines), (next_cost, next_lines) = rest[j + 1], here[j + 1]
            if is_any:
                ways = [here[j], (next_cost, next_lines)]
            elif pattern.fullmatch(found[j].strip()):
                ways = [(cost, (line, *lines)), here[j]]
            else:
                ways = [(cost + REPLACED, (found[j], *lines)), here[j]]
            if not is_any:
                ways.append((next_cost + SHIFTED, (found[j], *next_lines)))
            here[j] = min(ways, key=lambda way: way[0])
        rest = here
    return list(rest[0][1])
