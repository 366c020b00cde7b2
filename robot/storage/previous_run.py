"""How the previous run of the robot ended, from a mark on the disk and from its launcher."""

from contextlib import suppress
from pathlib import Path
from typing import Final

from robot.storage.writer import Directory
from runtime.watchdog import HANGS

NAME: Final = "life"
ENDING: Final = ".txt"
FILE_NAME: Final = f"{NAME}{ENDING}"
HUNG_NAME: Final = "hung.txt"
HUNG_BEFORE: Final = "hung-before.txt"
RUNNING: Final = "running"
STOPPED: Final = "was told to stop"
NO_REPORT: Final = "ended without a word"
SIGNAL: Final = "signal "


class PreviousRun:
    """Marks a directory while this robot lives; where that has no path it knows nothing.

    The marks are written like all that the robot saves, and so is reported that one was not.
    """

    def __init__(self, directory: Directory) -> None:
        self._directory = directory.path
        self._file = directory.file(NAME, ENDING)

    @property
    def trace(self) -> Path | None:
        """Where a loop that hangs leaves its place; None where nothing is kept."""
        return None if self._directory is None else self._directory / HUNG_NAME

    def begin(self, after: str = "") -> str:
        """How the one before ended, ready to follow "the one before"; empty when all was well.

        `after` is what whoever starts this one saw of it.
        """
        word = self._last_end()
        self._write(RUNNING)
        if word not in ("", RUNNING, STOPPED):
            return word
        return ending_of(after) or (NO_REPORT if word == RUNNING else "")

    def end(self, how: str = STOPPED) -> None:
        """This one ends by itself, and how."""
        self._write(how)

    def _last_end(self) -> str:
        if self._directory is None:
            return ""
        hung = self._directory / HUNG_NAME
        with suppress(OSError):
            if hung.stat().st_size:
                hung.replace(self._directory / HUNG_BEFORE)
                return HANGS
        with suppress(OSError, UnicodeDecodeError):
            return (self._directory / FILE_NAME).read_text(encoding="utf-8").strip()
        return ""

    def _write(self, word: str) -> None:
        if self._file is not None:
            self._file.put(word)


def ending_of(after: str) -> str:
    """A bare signal, as `--after "signal SIGKILL"` has it, was a kill."""
    return f"was killed ({after})" if after.startswith(SIGNAL) else after
