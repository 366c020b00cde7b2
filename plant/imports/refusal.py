"""How an importer refuses a file: as a world file is refused, with file, line, key and fix."""

from pathlib import Path

from plant.model.errors import Problem, WorldError


def refuse(file: str, key: str, reason: str, fix: str, line: int | None = None) -> WorldError:
    """To be raised."""
    return WorldError([Problem(file, line, key, reason, fix)])


def read_bytes(path: Path, most_bytes: int) -> bytes:
    """The file's content; WorldError when it cannot be read or is larger than that."""
    file = str(path)
    try:
        if path.exists() and not path.is_file():
            raise refuse(file, "file", "not a regular file", "give a file")
        with path.open("rb") as opened:
            data = opened.read(most_bytes + 1)
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        fix = "give a file that can be read"
        raise refuse(file, "file", f"cannot be read: {reason}", fix) from None
    if len(data) > most_bytes:
        fix = "is it the right file? cut it to size"
        raise refuse(file, "file", f"larger than {most_bytes} bytes", fix)
    return data


def read_text(path: Path, most_bytes: int) -> str:
    """The same as text, its lines ended by a newline alone."""
    data = read_bytes(path, most_bytes)
    try:
        return data.decode("utf-8-sig").replace("\r\n", "\n")
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        fix = "is it the right file? save it as UTF-8"
        raise refuse(str(path), "file", "not UTF-8 text", fix, line) from None
