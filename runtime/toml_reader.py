"""TOML as tables, from people: the standard parser, kept from what would take it hours."""

import re
import tomllib
from typing import Any, Final

MAX_BYTES: Final = 1_000_000
MAX_DOTS: Final = 100
"""Of one key. The parser's time grows with their square."""

NAME: Final = r"""(?:[\w-]++|"[^"\n]*+"|'[^'\n]*+')"""
DOTTED: Final = re.compile(rf"(?<![\w-])(?:{NAME}[ \t]*+\.[ \t]*+){{{MAX_DOTS}}}")


class TooDeepError(ValueError):
    """Lists in lists, or tables in tables, beyond what can be read."""


def table_in(text: str) -> dict[str, Any]:
    """The tables of a text; ValueError says what is wrong and, where it is known, the line."""
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
