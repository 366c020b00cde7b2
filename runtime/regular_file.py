"""Read a file of which nothing is certain: it may be a pipe, a device, too large or no text.

Every file that a user names is read here, so that none of them can hold up a process or fill its
memory.
"""

import os
import stat
from errno import EFBIG, EINVAL
from pathlib import Path
from typing import BinaryIO


class UnusableFileError(OSError):
    """A file that is no regular one, or too large; its text is the reason alone."""

    def __str__(self) -> str:
        return str(self.strerror)


def text_in(path: Path, most_bytes: int) -> str:
    """Return the text of a regular file of at most this size, with newlines as line ends.

    Raises:
        FileNotFoundError: There is no such file.
        OSError: It is not readable; UnusableFileError if it is no regular file, or too large.
        UnicodeDecodeError: It is no text in UTF-8.
    """
    return bytes_in(path, most_bytes).decode().replace("\r\n", "\n")


def bytes_in(path: Path, most_bytes: int) -> bytes:
    """Return the content of a regular file of at most this size; raise OSError as `text_in`."""
    number = _open(path)
    try:
        data = b""
        while len(data) <= most_bytes and (more := os.read(number, most_bytes + 1)):
            data += more
    finally:
        os.close(number)
    if len(data) > most_bytes:
        raise UnusableFileError(EFBIG, f"larger than {most_bytes} bytes")
    return data


def opened(path: Path) -> BinaryIO:
    """Open a regular file of any size; raise OSError as `text_in`."""
    return os.fdopen(_open(path), "rb")


def _open(path: Path) -> int:
    # Not blocking: to open a pipe would wait for a writer.
    number = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    if stat.S_ISREG(os.fstat(number).st_mode):
        return number
    os.close(number)
    raise UnusableFileError(EINVAL, "not a regular file")


def is_there(path: Path) -> bool:
    """Return whether anything has this name; a link counts although its target is missing.

    Raises:
        OSError: It cannot be found out.
    """
    try:
        os.lstat(path)
    except (FileNotFoundError, NotADirectoryError):
        return False
    return True
