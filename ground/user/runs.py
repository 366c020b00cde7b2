"""Runtime files: each `up` writes where it runs, so that other commands find it.

A file is readable only by its user, and is written as a whole. It is removed at the end of the run.
The file of a run that was killed is recognised by its process, and removed by the next reader. A
process is identified for longer than its id, which the system gives to another one later.
"""

import os
import re
import socket
import stat
from contextlib import suppress
from datetime import UTC, datetime
from functools import cache
from itertools import count
from pathlib import Path
from typing import Final, NamedTuple

import msgspec

from ground.user.folders import PRIVATE_FILE, PRIVATE_FOLDER, runs_folder
from protocol.bus.network import check_endpoint
from protocol.topic import robot_name
from runtime.errors import UserError
from runtime.files import make_folder

PROC: Final = Path("/proc")
AFTER_NAME: Final = ")"
"""Ends the name of the program in `stat`; the name may contain blanks and this character."""
STATE: Final = 0
"""Field of `stat` after the name."""
START: Final = 19
"""Field of `stat` after the name: clock ticks since the boot."""
ENDED: Final = ("Z", "X")


def start_of(pid: int) -> str | None:
    """Return the boot and the start time of a process; None if it does not run.

    Where the system has no /proc, the text is empty for a process that runs.
    """
    if not PROC.joinpath("self").exists():
        return "" if _exists(pid) else None
    try:
        text = PROC.joinpath(str(pid), "stat").read_text(errors="replace")
    except OSError:
        return None
    fields = text.rpartition(AFTER_NAME)[2].split()
    return None if fields[STATE] in ENDED else f"{_boot()} {fields[START]}"


@cache
def _boot() -> str:
    """Return the id of this boot."""
    try:
        return PROC.joinpath("sys/kernel/random/boot_id").read_text().strip()
    except OSError:
        return "unknown"


def _exists(pid: int) -> bool:
    """Return whether there is a process with this id."""
    try:
        os.kill(pid, 0)
    except PermissionError:
        return True
    except OSError:
        return False
    return True


SUFFIX: Final = ".json"
MAX_BYTES: Final = 1 << 16
OTHERS: Final = 0o077
OTHERS_WRITE: Final = 0o022
NAME: Final = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]{0,39}\Z")
UNNAMED: Final = "run"


class Run(msgspec.Struct, frozen=True, kw_only=True):
    """One run of `up`.

    `start` identifies the process `pid`. `locks` is the folder of the certificates and `record`
    that of the recordings. `recordings` are those of this run. `processes` has the pid of each
    role, `stop_at` where each robot receives stop datagrams if not at the endpoint.
    """

    pid: int
    start: str
    host: str
    since: datetime
    endpoint: str
    robots: list[str]
    world: str
    locks: str | None = None
    record: str | None = None
    recordings: list[str] = []
    processes: dict[str, int] = {}
    stop_at: dict[str, str] = {}


class FoundRun(NamedTuple):
    """A run with its name, which is the stem of its file."""

    name: str
    run: Run


class Ignored(NamedTuple):
    """A file that is not used, and the reason."""

    file: Path
    why: str


class Runs(NamedTuple):
    """The runs of this user on this machine, the oldest first, and the files that are not used."""

    found: list[FoundRun]
    ignored: list[Ignored]


class RunFile:
    """The runtime file of this process; `write` creates or replaces it."""

    def __init__(self, world: str, folder: Path | None = None) -> None:
        """`world` becomes the name of the run, with a number if another run has it."""
        self.path: Path | None = None
        self._stem = re.sub(r"[^A-Za-z0-9_-]+", "-", world).strip("-_")[:32] or UNNAMED
        self._folder = runs_folder() if folder is None else folder

    def write(self, run: Run) -> None:
        """Write the file; raise OSError if that fails."""
        folder = self._folder
        if self.path is None:
            make_folder(folder)
            folder.chmod(PRIVATE_FOLDER)
            read_runs(folder)  # removes the files of dead runs, so that their names are free
        draft = folder / f".{os.getpid()}.part"
        write_privately(draft, msgspec.json.encode(run))
        try:
            if self.path is None:
                self.path = link_to_free_name(draft, self._stem)
            else:
                os.replace(draft, self.path)
        finally:
            draft.unlink(missing_ok=True)

    def remove(self) -> None:
        """Remove the file, if there is one."""
        if self.path is not None:
            with suppress(OSError):
                self.path.unlink(missing_ok=True)
            self.path = None


def write_privately(path: Path, data: bytes) -> None:
    """Write a file that only this user can read."""
    flags = os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_NOFOLLOW | os.O_CLOEXEC
    with os.fdopen(os.open(path, flags, PRIVATE_FILE), "wb") as file:
        os.fchmod(file.fileno(), PRIVATE_FILE)
        file.write(data)


def link_to_free_name(draft: Path, stem: str) -> Path:
    """Give a file a second name that no other run has, such as box or box-2; return its path."""
    for number in count(1):
        path = draft.with_name(f"{stem}{SUFFIX}" if number == 1 else f"{stem}-{number}{SUFFIX}")
        with suppress(FileExistsError):
            os.link(draft, path)
            break
    return path


def this_run(
    *,
    endpoint: str,
    robots: list[str],
    world: str,
    locks: str | None,
    record: str | None,
    recordings: list[str],
    processes: dict[str, int],
    since: datetime,
    stop_at: dict[str, str] | None = None,
) -> Run:
    """Return the run whose `up` is this process."""
    return Run(
        pid=os.getpid(),
        start=start_of(os.getpid()) or "",
        host=socket.gethostname(),
        since=since,
        endpoint=endpoint,
        robots=robots,
        world=world,
        locks=None if locks is None else str(Path(locks).resolve()),
        record=record,
        recordings=recordings,
        processes=processes,
        stop_at=stop_at or {},
    )


def read_runs(folder: Path | None = None) -> Runs:
    """Return the runs of this user on this machine; remove the files of those that have ended."""
    folder = runs_folder() if folder is None else folder
    found: list[FoundRun] = []
    ignored: list[Ignored] = []
    try:
        refuse_strangers(folder.stat(), OTHERS_WRITE)
        files = sorted(folder.glob(f"*{SUFFIX}"))
    except FileNotFoundError:
        return Runs([], [])
    except (OSError, UserError) as error:
        return Runs([], [Ignored(folder, reason_of(error))])
    for path in files:
        try:
            run = read_run(path)
        except FileNotFoundError:
            continue
        except (OSError, UserError) as error:
            ignored.append(Ignored(path, reason_of(error)))
            continue
        if run.host != socket.gethostname():
            continue  # of another machine with the same home
        if start_of(run.pid) == run.start:
            found.append(FoundRun(path.stem, run))
        else:
            with suppress(OSError):
                path.unlink(missing_ok=True)
    return Runs(sorted(found, key=lambda one: one.run.since), ignored)


def read_run(path: Path) -> Run:
    """Read a runtime file; raise OSError or UserError for one that must not be used."""
    number = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC)
    with os.fdopen(number, "rb") as file:
        facts = os.fstat(file.fileno())
        if not stat.S_ISREG(facts.st_mode):
            raise UserError("is not a file")
        refuse_strangers(facts, OTHERS)
        data = file.read(MAX_BYTES + 1)
    try:
        run = msgspec.json.decode(data, type=Run)
        check_endpoint(run.endpoint)
        for robot in run.robots:
            robot_name(robot)
    except (msgspec.MsgspecError, UserError, ValueError) as error:
        raise UserError(f"is not a runtime file: {error}") from error
    if not (run.robots and run.since.tzinfo and NAME.match(path.stem)):
        raise UserError("is not a runtime file")
    return run


def refuse_strangers(facts: os.stat_result, forbidden: int) -> None:
    """Raise UserError unless this user owns the file, and others lack these permissions."""
    if facts.st_uid != os.geteuid():
        raise UserError(f"belongs to user {facts.st_uid}")
    if facts.st_mode & forbidden:
        raise UserError(f"has permissions {stat.S_IMODE(facts.st_mode):04o}: others can use it")


def reason_of(error: Exception) -> str:
    """Return the reason of an error without its file."""
    return (error.strerror or str(error)) if isinstance(error, OSError) else str(error)


def age_text(since: datetime, now: datetime | None = None) -> str:
    """Return how long a run has lasted, such as `4 min`."""
    minutes = max(0, round(((now or datetime.now(UTC)) - since).total_seconds() // 60))
    if minutes < 60:
        return f"{minutes} min"
    return f"{minutes // 60} h {minutes % 60} min"
