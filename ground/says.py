"""What a verb tells: exactly one result on standard output, everything else on standard error."""

import json
import sys
from math import isfinite
from typing import TextIO


class Says:
    """`line` rewrites itself in a terminal; elsewhere only `note` leaves a trace."""

    def __init__(self, *, as_json: bool, out: TextIO | None = None, err: TextIO | None = None):
        self.as_json = as_json
        self._out = out or sys.stdout
        self._err = err or sys.stderr
        self.live = self._err.isatty()
        self._open = 0
        self.told = False

    def note(self, text: str) -> None:
        """Something on the way, not the result."""
        self.end_line()
        print(text, file=self._err, flush=True)

    def line(self, text: str) -> None:
        """The present state, in place of the last one."""
        shown = text.ljust(self._open)
        self._err.write(f"\r{shown}")
        self._err.flush()
        self._open = len(text)

    def end_line(self) -> None:
        if self._open:
            self._err.write("\n")
            self._err.flush()
            self._open = 0

    def result(self, found: dict[str, object], text: str) -> None:
        """The one result, as JSON or in words."""
        self.end_line()
        self.told = True
        print(dumps(found) if self.as_json else text, file=self._out, flush=True)


def dumps(found: dict[str, object]) -> str:
    """Strict JSON: what is not finite becomes null."""
    return json.dumps(_finite(found), allow_nan=False, ensure_ascii=False)


def _finite(value: object) -> object:
    if isinstance(value, float) and not isfinite(value):
        return None
    if isinstance(value, dict):
        return {str(key): _finite(inner) for key, inner in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(inner) for inner in value]
    return value
