"""The lines typed before: bounded, without repetitions, and kept in a file if there is one."""

import os
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Final

from ground.user.folders import PRIVATE_FILE
from runtime.files import bytes_in

MAX_LINES: Final = 500
MAX_BYTES: Final = 1 << 20


class History:
    """The lines typed before; `previous` and `next` find those that begin as the line being typed.

    A file that cannot be read or written is not an exception: `trouble` holds the error.
    """

    def __init__(self, path: Path | None = None, most: int = MAX_LINES) -> None:
        self._path = path
        self._most = most
        self.trouble = ""
        self.lines = self._read()
        self._at = len(self.lines)
        self._begun = ""

    def add(self, line: str) -> None:
        """Append a line, and move to the end."""
        line = line.strip()
        if line and line.isprintable() and line != (self.lines[-1] if self.lines else ""):
            self.lines = [*self.lines, line][-self._most :]
            self._write()
        self._at, self._begun = len(self.lines), ""

    def previous(self, typed: str) -> str:
        """Return the line before; at the oldest one return what was typed."""
        if self._at == len(self.lines):
            self._begun = typed
        for at in range(self._at - 1, -1, -1):
            if self.lines[at].startswith(self._begun):
                self._at = at
                return self.lines[at]
        return typed

    def next(self, typed: str) -> str:
        """Return the line after; after the newest one return what was typed first."""
        if self._at == len(self.lines):
            return typed
        for at in range(self._at + 1, len(self.lines)):
            if self.lines[at].startswith(self._begun):
                self._at = at
                return self.lines[at]
        self._at = len(self.lines)
        return self._begun

    def search(self, words: str) -> list[str]:
        """Return the lines that contain all these words, the newest first, each once."""
        wanted = words.casefold().split()
        found = dict.fromkeys(reversed(self.lines))
        return [line for line in found if all(word in line.casefold() for word in wanted)]

    def uses(self) -> Mapping[str, int]:
        """Return how often each word begins a line."""
        return Counter(line.split(maxsplit=1)[0] for line in self.lines)

    def _read(self) -> list[str]:
        if self._path is None:
            return []
        try:
            lines = bytes_in(self._path, MAX_BYTES).decode(errors="replace").splitlines()
        except FileNotFoundError:
            return []
        except OSError as error:
            self.trouble = f"{self._path}: {error.strerror}: remove it"
            return []
        return [line for line in lines if line and line.isprintable()][-self._most :]

    def _write(self) -> None:
        """Write the file atomically, readable by this user only."""
        if self._path is None:
            return
        beside = self._path.with_name(f"{self._path.name}.{os.getpid()}")
        try:
            self._path.parent.mkdir(parents=True, exist_ok=True)
            beside.touch(PRIVATE_FILE)
            beside.write_text("\n".join([*self.lines, ""]), encoding="utf-8")
            os.replace(beside, self._path)
        except OSError as error:
            self.trouble = f"{self._path}: {error.strerror}"
            return
        self.trouble = ""
