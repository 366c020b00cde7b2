"""A file of ours is replaced as a whole or stays as it was; a link keeps leading to it."""

import os
from contextlib import suppress
from pathlib import Path

from protocol.errors import UserError


def replace(path: Path, text: str) -> None:
    """UserError, with the reason, when it cannot be written."""
    file = Path(os.path.realpath(path))
    draft = file.with_name(f".{file.name}.part")
    try:
        draft.write_text(text, encoding="utf-8")
        os.replace(draft, file)
    except OSError as error:
        with suppress(OSError):
            draft.unlink()
        raise UserError(f"{path}: {(error.strerror or 'cannot be written').lower()}") from error
