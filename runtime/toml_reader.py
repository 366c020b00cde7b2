"""Read TOML with the standard parser, protected, and find the line of each key."""

import re
import tomllib
from typing import Any, Final, TypeAlias

from runtime.errors import not_a_number

Key: TypeAlias = tuple[str | int, ...]

TOKEN = re.compile(
    r'"""(?:\\.|[^\\])*?"""+|' + r"'''.*?'''+|" + r'"(?:\\.|[^"\\\n])*"|' + r"'[^'\n]*'|"
    r"#[^\n]*|\n|[\[\]{},=.]|[^\s\[\]{},=.#\"']+",
    re.DOTALL,
)
END = ""

MAX_BYTES: Final = 1_000_000
MAX_DOTS: Final = 100
"""Maximum of dots in one key: the parser's time grows with their square."""

NAME: Final = r"""(?:[\w-]++|"[^"\n]*+"|'[^'\n]*+')"""
DOTTED: Final = re.compile(rf"(?<![\w-])(?:{NAME}[ \t]*+\.[ \t]*+){{{MAX_DOTS}}}")


DECIMAL_COMMA: Final = re.compile(
    r"^[\w\"'. -]+=[ \t]*(?P<number>[+-]?\d+,\d+)[ \t]*(?:#.*)?$", re.MULTILINE
)
"""A line with a decimal comma, which TOML does not have."""


class TooDeepError(ValueError):
    """Lists or tables are nested too deeply."""


def table_in(text: str) -> dict[str, Any]:
    """Return the tables of a text; ValueError has the problem and, if known, the line."""
    check_size(text)
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        if found := DECIMAL_COMMA.search(text):
            line = text.count("\n", 0, found.start()) + 1
            raise ValueError(f"{not_a_number(found['number'])} (at line {line})") from error
        raise
    except ValueError as error:
        raise ValueError("a number is too long") from error
    except RecursionError as error:
        raise TooDeepError("nested too deeply") from error


def check_size(text: str) -> None:
    """Raise ValueError for a text or a key that would take the parsers long."""
    if len(text) > MAX_BYTES:
        raise ValueError(f"is larger than {MAX_BYTES} bytes")
    if found := DOTTED.search(text):
        line = text.count("\n", 0, found.start()) + 1
        raise ValueError(f"A key has more than {MAX_DOTS} parts (at line {line}, column 1)")


def key_lines(text: str) -> dict[Key, int]:
    """Map each key path, list indices included, to its line; `text` must be valid TOML.

    Raises TooDeepError, or ValueError as `table_in`.
    """
    check_size(text)
    try:
        return _Scanner(text).document()
    except RecursionError as error:
        raise TooDeepError("nested too deeply") from error


class _Scanner:
    def __init__(self, text: str) -> None:
        self._tokens: list[tuple[str, int]] = []
        self._lines: dict[Key, int] = {}
        self._tables_in: dict[Key, int] = {}
        self._next = 0
        line, end = 1, 0
        for match in TOKEN.finditer(text):
            line += text.count("\n", end, match.start())
            end = match.start()
            if not match.group().startswith("#"):
                self._tokens.append((match.group(), line))

    def document(self) -> dict[Key, int]:
        table: Key = ()
        while (token := self._peek()) != END:
            if token == "\n":
                self._take()
            elif token == "[":
                table = self._header()
            else:
                self._pair(table)
        return self._lines

    def _peek(self) -> str:
        return self._tokens[self._next][0] if self._next < len(self._tokens) else END

    def _take(self) -> str:
        token = self._peek()
        self._next += 1
        return token

    def _line(self) -> int:
        return self._tokens[min(self._next, len(self._tokens) - 1)][1]

    def _header(self) -> Key:
        line = self._line()
        self._take()
        of_array = self._peek() == "["
        *parents, last = self._names()
        while self._peek() == "]":
            self._take()
        key: Key = ()
        for name in parents:
            key = (*key, name)
            if key in self._tables_in:
                key = (*key, self._tables_in[key] - 1)
        key = (*key, last)
        if of_array:
            index = self._tables_in.get(key, 0)
            self._tables_in[key] = index + 1
            self._lines.setdefault(key, line)
            key = (*key, index)
        self._lines[key] = line
        return key

    def _names(self) -> list[str]:
        names = []
        while (token := self._peek()) not in ("=", "]", END):
            if token not in (".", "["):
                names.append(token.strip("\"'"))
            self._take()
        return names or [""]

    def _pair(self, table: Key) -> None:
        line = self._line()
        key = table
        for name in self._names():
            key = (*key, name)
            self._lines.setdefault(key, line)
        self._take()
        self._value(key)

    def _value(self, key: Key) -> None:
        token = self._take()
        if token == "{":
            while self._more("}"):
                self._pair(key)
        elif token == "[":
            index = 0
            while self._more("]"):
                self._lines[(*key, index)] = self._line()
                self._value((*key, index))
                index += 1
        else:
            while self._peek() not in (",", "]", "}", "\n", END):
                self._take()

    def _more(self, closing: str) -> bool:
        while self._peek() in (",", "\n"):
            self._take()
        if self._peek() in (closing, END):
            self._take()
            return False
        return True
