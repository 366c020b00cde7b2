"""Keep the emergency stop over a restart of the robot's process.

The file exists while the stop is latched. Its content is for people: a damaged file, a directory or
a device of this name stops the robot, too, because only an operator may release a stop.
"""

from pathlib import Path
from typing import Final

from protocol.wire.enums import Severity
from robot.storage.writer import Directory, StateFile
from runtime import regular_file

NAME: Final = "stop"
ENDING: Final = ".txt"
TEXT: Final = "The emergency stop holds until an operator clears it.\n"
SAVED: Final = "emergency stop saved: it holds over a restart"
RESTORED: Final = "the emergency stop of the previous run still holds: clear it to arm"


class KeptStop:
    """Whether the stop is latched, in a file of the directory, or of `folder` if one is given.

    Without both nothing is kept.
    """

    def __init__(self, directory: Directory, folder: Path | None = None) -> None:
        self._file = directory.file(NAME, ENDING, folder)

    def found(self) -> bool:
        """Return whether an earlier run has left a stop; one that cannot be looked up counts."""
        if self._file is None:
            return False
        try:
            is_there = regular_file.is_there(self._file.path)
        except OSError:
            return True
        self._file.found(TEXT if is_there else None)
        return is_there

    def keep(self, *, stopped: bool) -> None:
        """Write the file, or remove it; one that failed is tried again with the next call."""
        if self._file is not None:
            self._file.put(TEXT if stopped else None)

    def news_of(self, file: StateFile) -> tuple[Severity, str] | None:
        """Return what operators should know about a write that has ended; None if it is not ours.

        The removal of a file is no news.
        """
        if file is not self._file:
            return None
        if file.error is not None:
            words = file.error.strerror or str(file.error)
            if file.is_wanted:
                return Severity.CRITICAL, f"emergency stop NOT saved, press it again: {words}"
            return Severity.ERROR, f"{file.path} not removed, clear the stop again: {words}"
        is_kept = file.is_wanted and file.on_disk is not None
        return (Severity.NOTICE, SAVED) if is_kept else None
