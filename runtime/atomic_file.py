"""Replace or remove a file so that a crash or a power cut leaves the old file or the new one.

Both are durable when they return: the content is synchronised before the rename, and the directory
after it. A file system may otherwise show the rename without the content, or forget it.
"""

import os
from contextlib import suppress
from errno import EINVAL
from pathlib import Path


def replace(path: Path, text: str) -> None:
    """Write `text` to `path` as a whole; a symbolic link keeps leading to its file.

    Raises OSError, and then leaves nothing half written behind.
    """
    file = Path(os.path.realpath(path))
    draft = file.with_name(f".{file.name}.part")
    try:
        write(draft, text.encode())
        os.replace(draft, file)
    except OSError:
        with suppress(OSError):
            os.unlink(draft)
        raise
    sync_folder(file.parent)


def remove(path: Path) -> None:
    """Remove a file; one that is not there stays away. Raises OSError."""
    try:
        os.unlink(path)
    except FileNotFoundError:
        if not os.path.isdir(path.parent):
            return
    sync_folder(path.parent)


def make_folder(path: Path) -> None:
    """Make a directory with its parents, unless it is there. Raises OSError."""
    if os.path.isdir(path):
        return
    make_folder(path.parent)
    with suppress(FileExistsError):
        os.mkdir(path)
    sync_folder(path.parent)


def write(path: Path, data: bytes) -> None:
    """Write a new file, or an old one afresh, and wait until its content is on the disk."""
    number = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_CLOEXEC, 0o666)
    try:
        while data:
            data = data[os.write(number, data) :]
        os.fsync(number)
    finally:
        os.close(number)


def sync_folder(path: Path) -> None:
    """Wait until the names in a directory are on the disk.

    A file system that cannot synchronise a directory says so by EINVAL; nothing can be done there.
    """
    number = os.open(path, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    try:
        os.fsync(number)
    except OSError as error:
        if error.errno != EINVAL:
            raise
    finally:
        os.close(number)
