"""The folders of this user, as the XDG base directory specification places them."""

import os
from itertools import count
from pathlib import Path
from typing import Final

from runtime.errors import UserError

NAME: Final = "sidestep"
PRIVATE_FOLDER: Final = 0o700
PRIVATE_FILE: Final = 0o600


def state_folder() -> Path:
    """Return the folder of the history, the recordings, the runtime files and the app's log."""
    return _base("XDG_STATE_HOME", Path(".local", "state")) / NAME


def recordings_folder() -> Path:
    """Return the default folder of recordings."""
    return state_folder() / "recordings"


def runs_folder() -> Path:
    """Return the folder of the runtime files of `up`.

    It is not below XDG_RUNTIME_DIR, which differs between a session, `su` and a cron job.
    """
    return state_folder() / "run"


def config_folder() -> Path:
    """Return the folder of the settings."""
    return _base("XDG_CONFIG_HOME", Path(".config")) / NAME


def free_path(name: str, suffix: str) -> Path:
    """Return the next free path in the folder of pictures; UserError if it cannot be made."""
    folder = state_folder() / "pictures"
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UserError(f"{folder}: {error.strerror}") from error
    paths = (folder / f"sidestep-{name}-{number}{suffix}" for number in count(1))
    return next(path for path in paths if not path.exists())


def _base(variable: str, usual: Path) -> Path:
    """Return the folder in the variable, if it is an absolute path, else below the home.

    A user without a home, as in a container with any number as its user, is at home in the root,
    where he may not write: programs go on as with a home that is read-only.
    """
    chosen = Path(os.environ.get(variable, ""))
    if chosen.is_absolute():
        return chosen
    try:
        return Path.home() / usual
    except RuntimeError:
        return Path("/") / usual
