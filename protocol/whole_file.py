"""A file of ours is replaced as a whole or stays as it was; a link keeps leading to it."""

import os
from contextlib import suppress
from pathlib import Path


def replace(path: Path, text: str) -> None:
    """Atomic, and on the disk when it returns: a crash leaves the old file or the new one.

    Raises OSError, and then leaves nothing half written behind.
    """
    file = Path(os.path.realpath(path))
    draft = file.with_name(f".{file.name}.part")
    try:
        with draft.open("w", encoding="utf-8") as writing:
            writing.write(text)
            writing.flush()
            os.fsync(writing.fileno())
        draft.replace(file)
    except OSError:
        with suppress(OSError):
            draft.unlink()
        raise
