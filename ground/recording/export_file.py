"""Write files that an operator asked for: complete, or not at all with a reason."""

from pathlib import Path

from runtime import files
from runtime.errors import UserError


def replace(path: Path, text: str) -> None:
    """Replace a file; on UserError the previous content is kept."""
    try:
        files.replace(path, text)
    except OSError as error:
        raise UserError(f"{path}: {(error.strerror or 'cannot be written').lower()}") from error
