"""Read a recording in the background, because a large one takes seconds."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Protocol, TypeVar

from ground.recording.log_reader import parts_of
from runtime.clock import WallClock
from runtime.errors import UserError

if TYPE_CHECKING:
    from ground.app.playback.player import Player

T = TypeVar("T")


class RunInBackground(Protocol):
    """Runs a job in a thread, and hands its result to `done` in this thread."""

    def __call__(self, job: Callable[[], T], done: Callable[[T], None]) -> None:
        """Start the job."""


class RecordingReader:
    """Reads one recording at a time; a newer one replaces an older one that is being read."""

    def __init__(self, run_in_background: RunInBackground) -> None:
        self._run_in_background = run_in_background
        self._path: Path | None = None
        self._share = 0.0

    @property
    def words(self) -> str:
        """Return what is being read and how far, or an empty text."""
        return "" if self._path is None else f"reading {self._path.name}  {self._share:.0%}"

    def begin(self, path: Path, done: Callable[["Player"], None]) -> None:
        """Begin to read; UserError if there is no such file. Other errors go to the log."""
        if not any(part.exists() for part in parts_of(path)):
            raise UserError(f"{path}: there is no such file")
        self._path, self._share = path, 0.0

        def read() -> "Player":
            from ground.app.playback.player import Player  # rarely needed, so imported late

            try:
                return Player(path, WallClock(), progress=lambda share: self._advance(path, share))
            except Exception:
                self._end(path)
                raise

        def take(player: "Player") -> None:
            if self._path is path:
                self._end(path)
                done(player)

        self._run_in_background(read, take)

    def _advance(self, path: Path, share: float) -> None:
        if self._path is path:
            self._share = share

    def _end(self, path: Path) -> None:
        if self._path is path:
            self._path = None
