"""Read TOML with the standard parser, protected from input that would take it hours."""

import re
import tomllib
from typing import Any, Final

MAX_BYTES: Final = 1_000_000
MAX_DOTS: Final = 100
"""Maximum of dots in one key: the parser's time grows with their square."""

NAME: Final = r"""(?:[\w-]++|"[^"\n]*+"|'[^'\n]*+')"""
DOTTED: Final = re.compile(rf"(?<![\w-])(?:{NAME}[ \t]*+\.[ \t]*+){{{MAX_DOTS}}}")


class TooDeepError(ValueError):
    """Lists or tables are nested too deeply."""


def table_in(text: str) -> dict[str, Any]:
    """Return the tables of a text; ValueError has the problem and, if known, the line."""
    if len(text) > MAX_BYTES:
        raise ValueError(f"is larger than {MAX_BYTES} bytes")
    if found := DOTTED.search(text):
        line = text.count("\n", 0, found.start()) + 1
        raise ValueError(f"A key has more than {MAX_DOTS} parts (at line {line}, column 1)")
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError:
        raise
    except ValueError as error:
        raise ValueError("a number is too long") from error
    except RecursionError as error:
        raise TooDeepError("nested too deeply") from error
