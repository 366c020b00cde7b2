"""Files that an operator has asked for: written whole, or refused with the reason."""

from pathlib import Path

from runtime import atomic_file
from runtime.errors import UserError


def replace(path: Path, text: str) -> None:
    """UserError, with the reason, when it cannot be written; then what was there still is."""
    try:
        atomic_file.replace(path, text)
    except OSError as error:
        raise UserError(f"{path}: {(error.strerror or 'cannot be written').lower()}") from error
