"""Find recordings: those in a folder, the newest first, and the one that a user names."""

import re
from collections.abc import Iterable
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

from ground.recording.log_reader import is_running
from ground.recording.parts import NAMED, SUFFIXES, number_of, run_of
from ground.user.folders import recordings_folder
from runtime.errors import UserError

BACK: Final = re.compile(r"-(?P<number>[1-9]\d{0,3})\Z")
STAMP: Final = "%Y%m%dT%H%M%SZ"
STAMP_CHARS: Final = 16
UNFINISHED: Final = "is still being recorded"
FILE_HELP: Final = (
    "a .tlog or .mcap, or a folder: its newest one (default the newest finished one of"
    " `sidestep rec list`; -2 is the one before)"
)


def recordings_in(folder: Path, *, below: bool = False) -> list[Path]:
    """Return each run once, by the oldest part that is left, its .mcap if there is one.

    The newest is the first.

    `below`: also those one level below the folder. An unreadable folder has none.
    """
    found: dict[Path, Path] = {}
    try:
        for pattern in ("*", "*/*") if below else ("*",):
            paths = [path for path in folder.glob(pattern) if path.suffix in SUFFIXES]
            for path in sorted(paths, key=lambda path: (-number_of(path), path.suffix == ".mcap")):
                if path.is_file():
                    found[run_of(path)] = path
        return newest_first(found.values())
    except OSError:
        return []


def newest_first(paths: Iterable[Path]) -> list[Path]:
    """Return the recordings in order, the newest first; OSError if one has gone."""
    return sorted(paths, key=lambda path: (began(path), path.stem), reverse=True)


def began(path: Path) -> datetime:
    """Return when a recording began: by its name, else by the time of its file, in UTC."""
    if NAMED.match(path.stem):
        try:
            return datetime.strptime(path.stem[:STAMP_CHARS], STAMP).replace(tzinfo=UTC)
        except ValueError:
            pass
    return datetime.fromtimestamp(path.stat().st_mtime, UTC)


def recording_named(text: str | None) -> Path:
    """Return the recording for an argument FILE.

    None is the newest one of the user, `-2` the one before, and a folder its newest one. A
    recording that is still being written is chosen only by its name. Raises UserError if there is
    none.
    """
    back = BACK.match(text or "-1")
    if text is not None and (back is None or Path(text).exists()):
        path = Path(text)
        return newest(path, 1) if path.is_dir() else path
    assert back is not None, "the default matches"
    return newest(recordings_folder(), int(back["number"]))


def newest(folder: Path, number: int) -> Path:
    """Return the newest finished recording of a folder, or with 2 the one before."""
    found = recordings_in(folder)
    if not found:
        raise UserError(f"{folder}: there is no recording; `sidestep up` makes one, or name a FILE")
    finished = [path for path in found if not is_running(path)]
    if not finished:
        raise UserError(f"{found[0]} {UNFINISHED}, and there is no other: end the run, or name it")
    if number > len(finished):
        raise UserError(f"-{number}: there are only {len(finished)} recordings in {folder}")
    return finished[number - 1]


def remark_on(path: Path, named: str | None) -> str:
    """Return the text of a verb about its recording: its path, and whether it is unfinished."""
    if is_running(path):
        return f"{path} {UNFINISHED}: this is the part that is already written"
    return "" if str(path) == named else str(path)
