"""Parameters that survive a restart: a small JSON file, replaced as a whole or not at all."""

import json
from pathlib import Path

from protocol import whole_file
from protocol.json_text import value_in
from robot.core.parameters import Params
from robot.parameters import OutOfRange, Unknown, with_value

FILE_NAME = "parameters.json"


class Store:
    """Keeps what an operator has set, in `directory`; without a directory it keeps nothing."""

    def __init__(self, directory: Path | None) -> None:
        self.directory = directory
        self._path = None if directory is None else directory / FILE_NAME
        self._values: dict[str, float] = {}
        self._written: dict[str, float] = {}

    def holds(self, name: str, value: float) -> bool:
        """Whether this value is what a restart will find."""
        return self._written.get(name) == value

    def load(self, params: Params) -> tuple[Params, list[str]]:
        """Parameters with the saved values on top, and a warning for each that cannot be used."""
        if self._path is None:
            return params, []
        try:
            saved = dict(value_in(self._path.read_text(encoding="utf-8")))
        except FileNotFoundError:
            return params, []
        except (OSError, ValueError, TypeError) as error:
            return params, [f"{self._path}: not readable ({error}); defaults in force"]
        warnings = []
        for name, value in saved.items():
            try:
                params = with_value(params, name, float(value))
                self._values[name] = float(value)
            except (Unknown, OutOfRange, TypeError, ValueError) as error:
                warnings.append(f"{self._path}: {name}: ignored ({error})")
        self._written = dict(self._values)
        return params, warnings

    def save(self, name: str, value: float) -> None:
        """In force is what the caller says; this is what a restart finds. Raises OSError."""
        self._values[name] = value
        if self._path is None:
            return
        replace_whole(self._path, json.dumps(self._values, indent=1))
        self._written = dict(self._values)


def replace_whole(path: Path, text: str) -> None:
    """A crash leaves the old file or the new one; its directory is made. Raises OSError."""
    path.parent.mkdir(parents=True, exist_ok=True)
    whole_file.replace(path, text)
