"""TOML as tables, from people: the standard parser, kept from what would take it hours."""

import re
import tomllib
from typing import Any, Final

LARGEST_BYTES: Final = 1_000_000
MOST_DOTS: Final = 100
"""Of one key. The parser's time grows with their square."""

NAME: Final = r"""(?:[\w-]++|"[^"\n]*+"|'[^'\n]*+')"""
DOTTED: Final = re.compile(rf"(?<![\w-])(?:{NAME}[ \t]*+\.[ \t]*+){{{MOST_DOTS}}}")


class TooDeep(ValueError):
    """Lists in lists, or tables in tables, beyond what can be read."""


def table_in(text: str) -> dict[str, Any]:
    """The tables of a text; ValueError says what is wrong and, where it is known, the line."""
    if len(text) > LARGEST_BYTES:
        raise ValueError(f"is larger than {LARGEST_BYTES} bytes")
    if found := DOTTED.search(text):
        line = text.count("\n", 0, found.start()) + 1
        raise ValueError(f"A key has more than {MOST_DOTS} parts (at line {line}, column 1)")
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError:
        raise
    except ValueError as error:
        raise ValueError("a number is too long") from error
    except RecursionError as error:
        raise TooDeep("nested too deeply") from error
