"""Write state to files beside the control loop, which never waits for a disk, and read it whole.

A `StateFile` accepts new contents and passes the newest one to a writer. A `Ticket` shows whether
that content is on the disk. Only the loop's thread uses files and tickets.

Saved state is JSON with a checksum, from a regular file. A file of an earlier version has no
checksum. It is accepted, and gets one when it is next saved.
"""

import errno
import json
import logging
from pathlib import Path
from queue import Empty, SimpleQueue
from threading import Thread
from typing import Any, Final, NamedTuple, Protocol
from zlib import crc32

from runtime import files
from runtime.files import value_in

LOG = logging.getLogger(__name__)

UNKNOWN: Final = "\0"
"""Marks unknown file content; never equal to a saved text."""


class Job(NamedTuple):
    """Replace a file, or remove it if `text` is None; `number` counts the contents of the file."""

    path: Path
    text: str | None
    number: int


class Done(NamedTuple):
    """A finished job; its content is durable if `error` is None."""

    job: Job
    error: OSError | None


class Writer(Protocol):
    """Executes jobs in order."""

    def submit(self, job: Job) -> Done | None:
        """Accept a job; return its result if it has ended, else None and later in `done`."""
        ...

    def done(self) -> list[Done]:
        """Return the jobs that have ended since the last call."""
        ...

    def close(self, patience_s: float) -> None:
        """Finish the pending jobs, within `patience_s`."""
        ...


class InlineWriter:
    """Writes at once in the caller's thread, so that runs are reproducible."""

    def submit(self, job: Job) -> Done:
        """Execute a job and return its result."""
        return do(job)

    def done(self) -> list[Done]:
        """Return no jobs: `submit` has returned each result."""
        return []

    def close(self, patience_s: float) -> None:
        """Do nothing: no job is pending."""


class WriterThread:
    """Writes in its own thread, for which `submit` and `done` never wait.

    The callers bound the queue: a `StateFile` has at most one job pending.
    """

    def __init__(self) -> None:
        self._jobs: SimpleQueue[Job | None] = SimpleQueue()
        self._done: SimpleQueue[Done] = SimpleQueue()
        self._thread = Thread(target=self._run, name="writer", daemon=True)
        self._thread.start()

    def submit(self, job: Job) -> None:
        """Queue a job."""
        self._jobs.put(job)

    def done(self) -> list[Done]:
        """Return the jobs that have ended since the last call."""
        found: list[Done] = []
        while True:
            try:
                found.append(self._done.get_nowait())
            except Empty:
                return found

    def close(self, patience_s: float) -> None:
        """Finish the queued jobs, within `patience_s`."""
        self._jobs.put(None)
        self._thread.join(patience_s)

    def _run(self) -> None:
        while (job := self._jobs.get()) is not None:
            self._done.put(do(job))


def do(job: Job) -> Done:
    """Write a file so that a crash or a power cut leaves the old content or the new one."""
    try:
        if job.text is None:
            files.remove(job.path)
        else:
            files.make_folder(job.path.parent)
            files.replace(job.path, job.text)
    except OSError as error:
        return Done(job, error)
    except Exception as error:  # a defect must not end the thread silently
        LOG.exception("%s could not be written", job.path)
        return Done(job, OSError(errno.EIO, f"{type(error).__name__}: {error}"))
    return Done(job, None)


class StateFile:
    """One file; of several contents that arrive during a write only the newest is written."""

    def __init__(self, name: str, path: Path, writer: Writer) -> None:
        self.name = name
        self.path = path
        self.on_disk: str | None = UNKNOWN
        """Durable content; None if there is no file."""
        self.number = 0
        """Number of the newest content."""
        self.ended = 0
        """Number of the newest content whose write has ended, successfully or not."""
        self.durable = 0
        self.error: OSError | None = None
        """Error of the write that ended last; None if it succeeded."""
        self._text: str | None = UNKNOWN
        self._writer = writer
        self._submitted = 0
        """Number of the content that was handed to the writer last."""

    def found(self, text: str | None) -> None:
        """Note the content that an earlier run has left."""
        self.on_disk = self._text = text

    @property
    def is_wanted(self) -> bool:
        """Whether the newest content is a file, not its removal."""
        return self._text is not None

    @property
    def has_failed(self) -> bool:
        """Whether the write of the newest content has ended with an error."""
        return self.error is not None and self.ended == self.number

    def put(self, text: str | None) -> "Ticket":
        """Replace the content; with None, remove the file.

        Content that is present, or already being written, is not written again.
        """
        if text != self._text or self.has_failed:
            self._text = text
            self.number += 1
            self._submit()
        return self.ticket

    @property
    def ticket(self) -> "Ticket":
        """The ticket of the newest content."""
        return Ticket(self, self.number)

    def take(self, done: Done) -> None:
        """Note the result of a job and submit newer content, if any."""
        self.ended, self.error = done.job.number, done.error
        if done.error is None:
            self.durable, self.on_disk = done.job.number, done.job.text
        else:
            self.on_disk = UNKNOWN
        self._submit()

    def _submit(self) -> None:
        """Submit the newest content, unless a write is pending."""
        if self._submitted == self.ended:
            self.hand_over()

    def hand_over(self) -> None:
        """Submit the newest content if the writer does not have it."""
        if self._submitted == self.number:
            return
        self._submitted = self.number
        done = self._writer.submit(Job(self.path, self._text, self.number))
        if done is not None:
            self.take(done)


class Ticket(NamedTuple):
    """Tracks whether one content of a file is durable."""

    file: StateFile
    number: int

    @property
    def is_open(self) -> bool:
        """True until the write has ended."""
        return self.file.ended < self.number

    @property
    def error(self) -> OSError | None:
        """Why neither this content nor a newer one is durable; None if there is no error."""
        lost = not self.is_open and self.file.durable < self.number
        return self.file.error if lost else None


class Directory:
    """The files of one robot, which share a writer; without a path there are none."""

    def __init__(self, path: Path | None, writer: Writer | None = None) -> None:
        self.path = path
        self._writer = InlineWriter() if writer is None else writer
        self._files: dict[Path, StateFile] = {}
        self._collected: dict[Path, int] = {}

    def file(
        self, name: str, ending: str = ".json", folder: Path | None = None
    ) -> StateFile | None:
        """Return a file by its name without the ending, or None if nothing is stored.

        With `folder` it lies there instead.
        """
        place = folder or self.path
        if place is None:
            return None
        path = place / f"{name}{ending}"
        if path not in self._files:
            self._files[path] = StateFile(name, path, self._writer)
        return self._files[path]

    def collect(self) -> list[StateFile]:
        """Process the writer's results; return the files with a finished write."""
        for done in self._writer.done():
            self._files[done.job.path].take(done)
        changed = []
        for path, file in self._files.items():
            if file.ended != self._collected.get(path, 0):
                self._collected[path] = file.ended
                changed.append(file)
        return changed

    def close(self, patience_s: float) -> None:
        """Finish pending writes and write the newest content of each file."""
        for file in self._files.values():
            file.hand_over()
        self._writer.close(patience_s)


CHECKSUM: Final = "crc32"
SAVED: Final = "saved"
MAX_BYTES: Final = 1 << 20
"""The largest file: 256 mission items take 90 kB."""


def sealed(body: str) -> str:
    """Return a JSON text with its checksum, which holds for the values and not for the spaces."""
    return f'{{"{CHECKSUM}": "{checksum(value_in(body))}", "{SAVED}":\n{body}}}\n'


def checksum(value: object) -> str:
    """Return the CRC-32 of a JSON value in one order and notation."""
    return f"{crc32(json.dumps(value, sort_keys=True).encode()):08x}"


def unsealed(text: str) -> Any:
    """Return the value in a JSON text; ValueError if it is damaged."""
    value = value_in(text)
    if not isinstance(value, dict) or not value.keys() & {CHECKSUM, SAVED}:
        return value
    if value.keys() != {CHECKSUM, SAVED} or value[CHECKSUM] != checksum(value[SAVED]):
        raise ValueError("damaged: its checksum is wrong")
    return value[SAVED]


def text_in(path: Path) -> str:
    """Return the text of a state file; raise as `regular_file.text_in`."""
    return files.text_in(path, MAX_BYTES)
