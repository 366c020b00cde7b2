"""The recording of a session: always on unless refused, in a process of its own, and watched.

Whether it works is seen by the file alone: it grows, or the alarm is loud. So whoever writes it may
hang, be ended, or have no room left on its disk, and it is told in the same way.
"""

import argparse
import os
from contextlib import suppress
from pathlib import Path
from typing import Final, Protocol, Self

from ground.client.connection import Common
from ground.launch.child_processes import ChildDied, Children
from ground.recording.log_reader import robot_in
from ground.recording.retention import Retention, size_in, size_of
from runtime.clock import Clock
from runtime.errors import UserError
from runtime.units import NS_PER_S

FOLDER: Final = Path("sidestep") / "recordings"
ON: Final = "REC"
TROUBLE: Final = "REC!"
ROLE: Final = "recorder"
LOOK_NS: Final = NS_PER_S // 2
PATIENCE_NS: Final = 3 * NS_PER_S
FULL_BYTES: Final = 1 << 20
USUAL_KEEP: Final = "2GB"


def add_recording(parser: argparse.ArgumentParser) -> None:
    """`--record` and `--no-record`, for whatever opens the app."""
    both = parser.add_mutually_exclusive_group()
    says = f"a .tlog and an .mcap of every frame, there (on a terminal {usual_folder()})"
    both.add_argument("--record", metavar="DIR", help=says)
    both.add_argument("--no-record", action="store_true", help="write no recording")
    add_keep(parser)


def add_keep(parser: argparse.ArgumentParser) -> None:
    """`--keep`: how much of older recordings survives."""
    says = f"delete the oldest recordings there beyond so much (in {usual_folder()} {USUAL_KEEP};"
    parser.add_argument("--keep", metavar="SIZE", help=f"{says} elsewhere all are kept)")


def usual_folder() -> Path:
    state = os.environ.get("XDG_STATE_HOME")
    return (Path(state) if state else Path.home() / ".local" / "state") / FOLDER


def kept_in(folder: Path, keep: str | None) -> int | None:
    """How many bytes of recordings may be in a folder, None: any; UserError for what is none.

    Nothing is deleted unasked where somebody has chosen to record.
    """
    usual = USUAL_KEEP if folder.resolve() == usual_folder().resolve() else None
    wanted = keep or usual
    return None if wanted is None else size_in(wanted)


class RecordOptions(Protocol):
    """Where a session is to be recorded, if at all."""

    record: str | None
    no_record: bool


def folder_of(options: RecordOptions) -> Path | None:
    """Where the session is recorded; None when that is refused."""
    if options.no_record:
        return None
    return Path(options.record) if options.record else usual_folder()


class Recording:
    """`words` are for the status line. `poll` it often: twice a second it looks at the disk."""

    def __init__(
        self,
        folder: Path,
        common: Common,
        clock: Clock,
        config: str | None,
        keep: str | None = None,
    ) -> None:
        """`config` and `keep`: what was said, for a recorder that is started here."""
        self.words = ""
        self._folder = folder
        self._robot = common.robot
        self._clock = clock
        self._children = Children(clock)
        self._command = ["record", str(folder), "--connect", common.endpoint, "--id", common.robot]
        self._command += [] if config is None else ["--config", config]
        self._command += [] if keep is None else ["--keep", keep]
        self._before = self._files()
        self._last: Path | None = None
        self._size = 0
        self._grew_ns = self._look_ns = clock.now_ns()
        self._on = self._ours = False
        self._keep = keep
        self._news: list[str] = []

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._children.stop()

    def begin(self) -> None:
        """Start a recorder, or another one if the last has stopped; UserError while one works."""
        if self.words == ON:
            raise UserError("it is recorded already: record stop ends that")
        self._children.stop()
        self._tidy()
        self._before = self._files()
        self._children.start(ROLE, self._command)
        self._ours = True
        self.watch(self._before)

    def end(self) -> str:
        """End the recorder that was started here; the name of its file."""
        if not self._ours:
            raise UserError("nothing is being recorded here")
        file = self.file
        self._children.stop()
        self._on = self._ours = False
        self.words = ""
        return str(file) if file else "nothing was written"

    def watch(self, before: set[Path]) -> None:
        """Somebody records from now on; `before` are the files that were there already."""
        self._before = before
        self._last, self._size = None, 0
        self._grew_ns = self._clock.now_ns()
        self._on, self.words = True, ON

    @property
    def file(self) -> Path | None:
        """The newest one of this robot that was not there before."""
        new = self._files() - self._before
        return max(new, key=lambda path: path.name, default=None)

    def poll(self, *, heard: bool) -> list[str]:
        """What there is to tell, loudly: that it has stopped, why, and that it goes on.

        `heard`: is there something to record? A robot that is silent is no trouble of ours.
        """
        now_ns = self._clock.now_ns()
        news, self._news = self._news, []
        if not self._on or now_ns < self._look_ns:
            return news
        self._look_ns = now_ns + LOOK_NS
        size = self._size_now()
        if size != self._size:
            self._size, self._grew_ns = size, now_ns
        elif not heard and self.words == ON:
            self._grew_ns = now_ns
        was, self.words = self.words, ON if now_ns - self._grew_ns < PATIENCE_NS else TROUBLE
        if was == self.words:
            return news
        if self.words == ON:
            return [*news, "RECORDING goes on"]
        return [*news, f"RECORDING HAS STOPPED: {self._why()}; the robot drives on"]

    def _tidy(self) -> None:
        """Here and not by the recorder, whose words nobody would see."""
        shelf = Retention(self._folder, kept_in(self._folder, self._keep))
        with suppress(OSError):  # a folder that is not there yet is made by the recorder
            self._news += filter(None, (shelf.tidy(), shelf.warning()))

    def _size_now(self) -> int:
        """Another file is only looked for when this one does not grow: there may be very many."""
        size = 0 if self._last is None else size_of(self._last)
        if size == self._size:
            self._last = self.file
            size = 0 if self._last is None else size_of(self._last)
        return size

    def _why(self) -> str:
        try:
            self._children.check()
        except ChildDied as died:
            return str(died)
        try:
            disk = os.statvfs(self._folder)
        except OSError as error:
            return f"{self._folder}: {error.strerror}"
        if disk.f_bavail * disk.f_frsize < FULL_BYTES:
            return f"the disk is full ({self._folder})"
        return f"nothing was written to {self._folder} for {PATIENCE_NS // NS_PER_S} s"

    def _files(self) -> set[Path]:
        return {path for path in self._folder.glob("*.tlog") if robot_in(path) == self._robot}
