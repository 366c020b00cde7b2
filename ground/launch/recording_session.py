"""Record a session in a separate, supervised process; on unless disabled.

The check looks only at the file: it must grow, or an alarm is raised. A recorder that hangs, exits
or has no room on its disk is therefore reported in the same way.

Find the files of the recorders of this run, without other files in the same folder.
"""

import argparse
import os
import re
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Final, Protocol, Self

from ground.client.connection import Common
from ground.launch.child_processes import ChildExitError, Children
from ground.recording.catalogue import Retention, size_in, size_of_run
from ground.recording.log_reader import robot_in
from ground.user.folders import recordings_folder
from protocol.topic import NAME
from runtime.clock import Clock
from runtime.errors import UserError
from runtime.units import NS_PER_S

RECORDER: Final = "recorder"
"""Prefix of the role of each recorder."""
CREATED: Final = re.compile(
    rf"^recording .*?(?P<name>\d{{8}}T\d{{6}}Z-{NAME}(\.\d{{1,3}})?\.tlog) and \.mcap$",
    re.MULTILINE,
)


def created_line(robot: str, log: Path) -> str:
    """Return the line that a recorder prints when it has created its files."""
    return f"recording {robot} to {log} and .mcap"


class RecorderFiles:
    """The .tlog of each recorder among some children.

    Another run may record a robot of the same name in the same folder, so the names and times of
    the files do not identify the run. Each recorder prints the name of its file.
    """

    def __init__(self) -> None:
        self._found: dict[int, Path] = {}

    @property
    def all(self) -> list[Path]:
        """The files of all recorders so far, the newest last."""
        return list(self._found.values())

    def newest(self, robot: str) -> Path | None:
        """Return the file of the newest recorder of a robot, or None before one has created it."""
        return next((log for log in reversed(self.all) if robot_in(log) == robot), None)

    def update(self, children: Children, folder: Path) -> None:
        """Read the output of new recorders; call it before a child is removed."""
        for child in children.snapshot():
            pid = child.process.pid
            if child.role.startswith(RECORDER) and pid not in self._found:
                created = CREATED.search(child.first_output())
                if created is not None:
                    self._found[pid] = folder / created["name"]


WRITING: Final = "REC"
STALLED: Final = "REC!"
CHECK_NS: Final = NS_PER_S // 2
STALL_NS: Final = 3 * NS_PER_S
STARTING_NS: Final = 10 * NS_PER_S
"""A busy computer takes seconds to start a recorder."""
FULL_BYTES: Final = 1 << 20
DEFAULT_KEEP: Final = "2GB"


def add_recording(parser: argparse.ArgumentParser) -> None:
    """Add `--record` and `--no-record`, for verbs that open the app."""
    group = parser.add_mutually_exclusive_group()
    summary = (
        f"write a .tlog and an .mcap of every frame there (on a terminal {recordings_folder()})"
    )
    group.add_argument("--record", metavar="DIR", help=summary)
    group.add_argument("--no-record", action="store_true", help="write no recording")
    add_keep(parser)


def add_keep(parser: argparse.ArgumentParser) -> None:
    """Add `--keep`, the limit on the size of older recordings."""
    size = f"{DEFAULT_KEEP} in {recordings_folder()}; elsewhere all are kept"
    parser.add_argument(
        "--keep",
        metavar="SIZE",
        help=f"delete the oldest recordings there beyond this size (default {size})",
    )


def byte_limit(folder: Path, keep: str | None) -> int | None:
    """Return how many bytes of recordings a folder may hold, or None without limit.

    Outside the default folder nothing is deleted unless `keep` asks for it. Raises UserError for a
    malformed size.
    """
    default = DEFAULT_KEEP if folder.resolve() == recordings_folder().resolve() else None
    wanted = keep or default
    return None if wanted is None else size_in(wanted)


class RecordOptions(Protocol):
    """Options that decide where a session is recorded, if at all."""

    record: str | None
    no_record: bool


def folder_of(options: RecordOptions) -> Path | None:
    """Return the folder for the recording, or None when recording is disabled."""
    if options.no_record:
        return None
    return Path(options.record) if options.record else recordings_folder()


class RecordingSession:
    """Recording of a session.

    `words` are for the status line. Call `poll` often: twice a second it checks the file.
    """

    def __init__(
        self,
        folder: Path,
        common: Common,
        clock: Clock,
        config: str | None,
        keep: str | None = None,
    ) -> None:
        """`config` and `keep` are passed on to a recorder that is started here."""
        self.words = ""
        self._folder = folder
        self._robot = common.robot
        self._clock = clock
        self._children = Children(clock)
        self._command = ["record", str(folder), "--connect", common.endpoint, "--id", common.robot]
        self._command += [] if config is None else ["--config", config]
        self._command += [] if keep is None else ["--keep", keep]
        self._own_files = RecorderFiles()
        self._newest: Callable[[], Path | None] = self._newest_own
        self._file: Path | None = None
        self._size = 0
        self._grew_ns = self._look_ns = clock.now_ns()
        self._is_watching = self._is_child = False
        self._keep = keep
        self._messages: list[str] = []

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._children.stop()

    def begin(self) -> None:
        """Start a recorder, or another one if the last has stopped; UserError while one works."""
        if self.words == WRITING:
            raise UserError("already recording: end it with `record stop` first")
        self._children.stop()
        self._delete_old()
        self._own_files = RecorderFiles()
        self._children.start(RECORDER, self._command)
        self._is_child = True
        self.watch(self._newest_own)

    def end(self) -> str:
        """Stop the recorder that was started here and return the name of its file."""
        if not self._is_child:
            raise UserError("nothing is being recorded here")
        file = self.file
        self._children.stop()
        self._is_watching = self._is_child = False
        self.words = ""
        return str(file) if file else "nothing was written"

    def watch(self, newest: Callable[[], Path | None]) -> None:
        """Check a recorder from now on; `newest` returns its file, None before there is one."""
        self._newest = newest
        self._file, self._size = None, 0
        self._grew_ns = self._clock.now_ns()
        self._is_watching, self.words = True, WRITING

    @property
    def file(self) -> Path | None:
        """The first file of the newest run of the recorder; None before it has created one."""
        self._file = self._newest() or self._file
        return self._file

    def poll(self, *, is_receiving: bool) -> list[str]:
        """Return new messages for the operator: the recording has stopped and why, or has resumed.

        `is_receiving`: whether the robot sends anything. A silent robot is not a fault of the
        recorder.
        """
        now_ns = self._clock.now_ns()
        messages, self._messages = self._messages, []
        if not self._is_watching or now_ns < self._look_ns:
            return messages
        self._look_ns = now_ns + CHECK_NS
        size = 0 if self.file is None else size_of_run(self.file)
        if size != self._size:
            self._size, self._grew_ns = size, now_ns
        elif not is_receiving and self.words == WRITING:
            self._grew_ns = now_ns
        is_written = now_ns - self._grew_ns < (STARTING_NS if self._is_starting() else STALL_NS)
        was, self.words = self.words, WRITING if is_written else STALLED
        if was == self.words:
            return messages
        if self.words == WRITING:
            return [*messages, "RECORDING resumed"]
        return [*messages, f"RECORDING HAS STOPPED: {self._why()}; the robot drives on"]

    def _is_starting(self) -> bool:
        """Return whether a recorder of this run is running and has not written yet."""
        if not self._is_child or self._size:
            return False
        with suppress(ChildExitError):
            self._children.check()
            return True
        return False

    def _delete_old(self) -> None:
        """Delete old recordings here: the recorder's own messages would not be shown."""
        retention = Retention(self._folder, byte_limit(self._folder, self._keep))
        with suppress(OSError):  # a folder that is not there yet is made by the recorder
            self._messages += filter(None, (retention.delete_oldest(), retention.warning()))

    def _why(self) -> str:
        try:
            self._children.check()
        except ChildExitError as died:
            return str(died)
        try:
            disk = os.statvfs(self._folder)
        except OSError as error:
            return f"{self._folder}: {error.strerror}"
        if disk.f_bavail * disk.f_frsize < FULL_BYTES:
            return f"the disk is full ({self._folder})"
        silent_s = (self._clock.now_ns() - self._grew_ns) // NS_PER_S
        return f"nothing was written to {self._folder} for {silent_s} s"

    def _newest_own(self) -> Path | None:
        """Return the file of the recorder that was started here."""
        self._own_files.update(self._children, self._folder)
        return self._own_files.newest(self._robot)
