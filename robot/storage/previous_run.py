"""Record how a run of the robot ended, and report it at the next start."""

from contextlib import suppress
from pathlib import Path
from typing import Final

from robot.storage.sealed import text_in
from robot.storage.writer import Directory
from runtime.watchdog import HANGS

NAME: Final = "life"
ENDING: Final = ".txt"
FILE_NAME: Final = f"{NAME}{ENDING}"
HUNG_NAME: Final = "hung.txt"
HUNG_BEFORE: Final = "hung-before.txt"
RUNNING: Final = "running"
STOPPED: Final = "stopped on request"
STOPPED_BEFORE: Final = "was told to stop"
"""The same in files of earlier versions."""

NO_REPORT: Final = "ended without a report"
SIGNAL: Final = "signal "


class PreviousRun:
    """Marks a state directory while the robot runs; without a path it does nothing.

    The marks are written as all saved state, so that a failed write is reported.
    """

    def __init__(self, directory: Directory) -> None:
        self._directory = directory.path
        self._file = directory.file(NAME, ENDING)

    @property
    def trace(self) -> Path | None:
        """The file for the stack traces of a hung loop, or None if nothing is saved."""
        return None if self._directory is None else self._directory / HUNG_NAME

    def begin(self, after: str = "") -> str:
        """Mark the start; return how the previous run ended, or "" if it ended normally.

        `after` is what the launcher observed of it. The text continues "the previous run".
        """
        word = self._last_end()
        self._write(RUNNING)
        if word not in ("", RUNNING, STOPPED, STOPPED_BEFORE):
            return word
        return ending_of(after) or (NO_REPORT if word == RUNNING else "")

    def end(self, how: str = STOPPED) -> None:
        """Mark the end of this run and its cause."""
        self._write(how)

    def _last_end(self) -> str:
        if self._directory is None:
            return ""
        hung = self._directory / HUNG_NAME
        with suppress(OSError):
            if hung.stat().st_size:
                hung.replace(self._directory / HUNG_BEFORE)
                return HANGS
        with suppress(OSError, ValueError):
            return text_in(self._directory / FILE_NAME).strip()
        return ""

    def _write(self, word: str) -> None:
        if self._file is not None:
            self._file.put(word)


def ending_of(after: str) -> str:
    """Return the ending in words; a bare signal, such as `signal SIGKILL`, means killed."""
    return f"was killed ({after})" if after.startswith(SIGNAL) else after
