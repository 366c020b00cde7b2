"""Replace or remove a file so that a crash or a power cut leaves the old file or the new one.

Both are durable when they return: the content is synchronised before the rename, and the directory
after it. A file system may otherwise show the rename without the content, or forget it.
"""

import os
from contextlib import suppress
from errno import EINVAL
from pathlib import Path


def replace(path: Path, text: str) -> None:
    """Replace the content of a file as a whole; a symbolic link to a file keeps its target.

    A link to anything else is itself replaced: a device must not become a file. Raises OSError; no
    temporary file is left then.
    """
    file = Path(os.path.realpath(path))
    if file != path and os.path.exists(file) and not os.path.isfile(file):
        file = path
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
    """Remove a file, if it exists; raise OSError if that fails."""
    try:
        os.unlink(path)
    except FileNotFoundError:
        if not os.path.isdir(path.parent):
            return
    sync_folder(path.parent)


def make_folder(path: Path) -> None:
    """Create a directory and its parents, if missing; raise OSError if that fails."""
    if os.path.isdir(path):
        return
    make_folder(path.parent)
    with suppress(FileExistsError):
        os.mkdir(path)
    sync_folder(path.parent)


def write(path: Path, data: bytes) -> None:
    """Write a file, which may exist, and wait until its content is on the disk."""
    # Not blocking: to open a pipe would wait for a reader.
    flags = os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_NONBLOCK | os.O_CLOEXEC
    number = os.open(path, flags, 0o666)
    try:
        while data:
            data = data[os.write(number, data) :]
        os.fsync(number)
    finally:
        os.close(number)


def sync_folder(path: Path) -> None:
    """Wait until the entries of a directory are on the disk.

    A file system without this function reports EINVAL, which is ignored.
    """
    number = os.open(path, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    try:
        os.fsync(number)
    except OSError as error:
        if error.errno != EINVAL:
            raise
    finally:
        os.close(number)
