"""Replace a file so that a crash cannot harm it, and read untrusted files and JSON.

A crash or a power cut leaves the old file or the new one. Both are durable when `replace` or
`remove` returns: the content is synchronised before the rename, and the directory after it. A file
system may otherwise show the rename without the content, or forget it.

What a user names may be a pipe, a device, too large or no text. Every such file is read here, so
that none of them can hold up a process or fill its memory. Any problem of JSON raises ValueError,
also its depth or length.
"""

import json
import os
import stat
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from errno import EFBIG, EINVAL
from pathlib import Path
from typing import Any, BinaryIO, Final

from runtime.errors import UserError


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


def replace_named(path: Path, text: str) -> None:
    """Replace a file that a user named; on UserError the previous content is kept."""
    try:
        replace(path, text)
    except OSError as error:
        raise UserError(f"{path}: {(error.strerror or 'cannot be written').lower()}") from error


@contextmanager
def drafted(path: Path) -> Iterator[Path]:
    """Yield a path to write to, whose file replaces `path` at the end as a whole.

    After an error or an interruption no part of it is left, and the file is as it was. A pipe or a
    device is written directly. OSError names the file by its own path.
    """
    file = Path(os.path.realpath(path))
    if os.path.exists(file) and not os.path.isfile(file):
        yield path
        return
    draft = file.with_name(f".{file.stem}.part{file.suffix}")
    try:
        yield draft
        os.replace(draft, file)
    except BaseException as error:
        with suppress(OSError):
            os.unlink(draft)
        if isinstance(error, OSError) and error.filename is not None:
            error.filename, error.filename2 = str(path), None
        raise


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


class UnusableFileError(OSError):
    """A file that is no regular one, or too large; its text is the reason alone."""

    def __str__(self) -> str:
        return str(self.strerror)


def text_in(path: Path, most_bytes: int) -> str:
    """Return the text of a regular file of at most this size, as `decoded` does.

    Raises:
        FileNotFoundError: There is no such file.
        OSError: It is not readable; UnusableFileError if it is no regular file, or too large.
        UnicodeDecodeError: It is no text in UTF-8.
    """
    return decoded(bytes_in(path, most_bytes))


def decoded(data: bytes) -> str:
    """Return a UTF-8 text without byte order mark, with newlines as line ends.

    Raises:
        UnicodeDecodeError: It is no text in UTF-8.
    """
    return data.decode("utf-8-sig").replace("\r\n", "\n")


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


MAX_DEPTH: Final = 100
TOO_DEEP: Final = "nested too deeply"
MAX_DIGITS: Final = 18
"""A whole number with more digits becomes a float, possibly infinite."""


def value_in(text: str | bytes) -> Any:
    """Return the value of a JSON text; raise ValueError if it is invalid."""
    try:
        value = json.loads(text, parse_int=_number)
    except RecursionError as error:
        raise ValueError(TOO_DEEP) from error
    _check_depth(value)
    return value


def _check_depth(value: object) -> None:
    """Raise ValueError for values that are nested too deeply for recursive code."""
    level = [value]
    for _ in range(MAX_DEPTH):
        nested = [one for one in level if isinstance(one, dict | list)]
        level = [
            inner for one in nested for inner in (one.values() if isinstance(one, dict) else one)
        ]
        if not level:
            return
    raise ValueError(TOO_DEEP)


def _number(digits: str) -> int | float:
    return int(digits) if len(digits) <= MAX_DIGITS else float(digits)
