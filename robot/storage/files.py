"""Store parameters in a JSON file, which is replaced as a whole.

A state directory belongs to one robot, whose name is in a file there. This keeps a robot from using
the fence or the parameters of another.
"""

import json
from pathlib import Path
from typing import Final

from robot.core.parameters import Params
from robot.parameters.table import (
    OutOfRangeError,
    UnknownParameterError,
    concerns_safety,
    is_less_safe,
    with_value,
)
from robot.storage.kept_stop import KeptStop
from robot.storage.sealed import sealed, text_in, unsealed
from robot.storage.writer import Directory, Ticket, Writer
from runtime import files
from runtime.errors import UserError

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
