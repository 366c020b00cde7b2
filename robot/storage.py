"""The robot's state directory: its owner, its parameters, and how the previous run ended.

A state directory belongs to one robot, whose name is in a file there. This keeps a robot from using
the fence or the parameters of another. Parameters are a JSON file, which is replaced as a whole.
"""

import json
from contextlib import suppress
from pathlib import Path
from typing import Final

from robot.core.parameters import Params
from robot.emergency_stop import KeptStop
from robot.file_writer import Directory, Ticket, Writer, sealed, text_in, unsealed
from robot.parameter_table import (
    OutOfRangeError,
    UnknownParameterError,
    concerns_safety,
    is_less_safe,
    with_value,
)
from runtime import files
from runtime.errors import UserError
from runtime.watchdog import HANGS

NAME: Final = "parameters"
FILE_NAME: Final = f"{NAME}.json"
OWNER_NAME: Final = "robot.txt"
LOST: Final = "configured value in force; arming is refused until a safety parameter is set"


def own(directory: Path | None, robot: str) -> str:
    """Claim a state directory for a robot; return a warning if that cannot be written.

    Raises UserError if the directory belongs to another robot or its owner is unreadable.
    """
    if directory is None:
        return ""
    path = directory / OWNER_NAME
    try:
        owner = text_in(path).strip()
    except (FileNotFoundError, NotADirectoryError):
        return _note(path, robot)
    except (OSError, ValueError) as error:
        raise UserError(f"{path}: owner of the directory not readable: {error}") from None
    if owner != robot:
        raise UserError(
            f"--state {directory}: belongs to robot {owner[:32]!r}; give robot {robot} a directory "
            f"of its own, or remove {path.name} there to hand it over"
        )
    return ""


def _note(path: Path, robot: str) -> str:
    try:
        files.make_folder(path.parent)
        files.replace(path, robot)
    except OSError as error:
        return f"{path}: not written ({error.strerror})"
    return ""


class Store:
    """The saved parameters in `directory`; without a directory nothing is saved.

    Without a `writer` each change is written at once. The emergency stop is kept in `stop_folder`,
    by default in `directory`.
    """

    def __init__(
        self,
        directory: Path | None,
        writer: Writer | None = None,
        stop_folder: Path | None = None,
    ) -> None:
        self.directory = Directory(directory, writer)
        self.stop = KeptStop(self.directory, stop_folder)
        self._file = self.directory.file(NAME)
        self._values: dict[str, float] = {}
        self._durable: dict[str, float] = {}
        self._read: str | None = None
        self.damaged = False
        """Whether saved values that concern safety are lost, and no operator has set one since."""

    @property
    def ticket(self) -> Ticket | None:
        """The ticket of the newest write, or None if nothing is saved."""
        return None if self._file is None else self._file.ticket

    def holds(self, name: str, value: float) -> bool:
        """Return whether a restart would restore this value."""
        text = None if self._file is None else self._file.on_disk
        if text is not self._read:
            self._read, self._durable = text, values_in(text)
        return self._durable.get(name) == value

    def load(self, params: Params, configured: Params | None = None) -> tuple[Params, list[str]]:
        """Return the parameters with saved values applied, and a warning for each unusable value.

        With `configured`, values of the safety group must be at least as safe as there. An operator
        may have saved safer values than those. If they are lost, the robot is `damaged`.
        """
        if self._file is None:
            return params, []
        path = self._file.path
        try:
            text = text_in(path)
            saved = dict(unsealed(text))
        except FileNotFoundError:
            return params, []
        except (OSError, ValueError, TypeError) as error:
            self.damaged = True
            return params, [f"{path}: not readable ({error}); {LOST}"]
        self._file.found(text)
        warnings = []
        for name, value in saved.items():
            try:
                changed = with_value(params, name, float(value))
            except (UnknownParameterError, OutOfRangeError, TypeError, ValueError) as error:
                is_lost = concerns_safety(name)
                self.damaged |= is_lost
                warnings.append(f"{path}: {name}: {f'{error}; {LOST}' if is_lost else error}")
                continue
            if configured is not None and is_less_safe(name, float(value), configured):
                limit = getattr(configured, name)
                reason = f"{value:g} is less safe than configured, {limit:g}"
                warnings.append(f"{path}: {name}: ignored ({reason})")
            else:
                params, self._values[name] = changed, float(value)
        return params, warnings

    def save(self, name: str, value: float) -> Ticket | None:
        """Save a value for the next start; return its ticket, or None if nothing is saved."""
        self._values[name] = value
        if concerns_safety(name):
            self.damaged = False
        if self._file is None:
            return None
        return self._file.put(sealed(json.dumps(self._values, indent=1)))


def values_in(text: str | None) -> dict[str, float]:
    """Return the numbers in a parameter file; empty if it cannot be read."""
    try:
        saved = unsealed(text or "")
    except ValueError:
        return {}
    numbers = saved.items() if isinstance(saved, dict) else ()
    return {name: float(value) for name, value in numbers if isinstance(value, int | float)}


RUN_NAME: Final = "life"
ENDING: Final = ".txt"
RUN_FILE_NAME: Final = f"{RUN_NAME}{ENDING}"
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
        self._file = directory.file(RUN_NAME, ENDING)

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
            return text_in(self._directory / RUN_FILE_NAME).strip()
        return ""

    def _write(self, word: str) -> None:
        if self._file is not None:
            self._file.put(word)


def ending_of(after: str) -> str:
    """Return the ending in words; a bare signal, such as `signal SIGKILL`, means killed."""
    return f"was killed ({after})" if after.startswith(SIGNAL) else after
