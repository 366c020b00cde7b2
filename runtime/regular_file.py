"""Read a file of which nothing is certain: it may be a pipe, a device, too large or no text."""

import os
import stat
from pathlib import Path


def text_in(path: Path, most_bytes: int) -> str:
    """Return the text of a regular file of at most this size.

    Raises:
        FileNotFoundError: There is no such file.
        OSError, ValueError: It is not readable, no regular file, too large, or no text.
    """
    # Not blocking: to open a pipe would wait for a writer.
    number = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    try:
        if not stat.S_ISREG(os.fstat(number).st_mode):
            raise ValueError("not a regular file")
        data = b""
        while len(data) <= most_bytes and (more := os.read(number, most_bytes + 1)):
            data += more
    finally:
        os.close(number)
    if len(data) > most_bytes:
        raise ValueError(f"larger than {most_bytes} bytes")
    return data.decode()


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
