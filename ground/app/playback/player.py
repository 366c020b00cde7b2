"""Play a recording to a station: it plays, steps and seeks, also backwards.

A large recording takes seconds to read, so it is read in the background.
"""

from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Protocol, TypeVar

from ground.recording.catalogue import UNFINISHED
from ground.recording.log_reader import is_running, parts_of
from ground.recording.playback import ReplayBus
from ground.station.station import Station
from ground.station.world import WorldFacts, parse_world
from protocol.topics import WORLD
from runtime.clock import Clock, WallClock
from runtime.errors import RemoteError, UserError
from runtime.units import NS_PER_S


class Player:
    """Plays a recording.

    Seeking backwards replaces `station`, because the old one already knows the future.
    """

    def __init__(
        self,
        path: Path,
        clock: Clock,
        robot: str | None = None,
        progress: Callable[[float], None] = lambda _: None,
    ) -> None:
        """UserError when there is nothing to play; `progress` receives the share that was read."""
        self.path = path
        self.bus = ReplayBus(path, clock, robot, progress)
        self._world = world_in_recording(self.bus)
        self.station = self._station()
        self.note(f"{path.name}: {self.duration_s:.1f} s of {self.bus.robot}")
        if is_running(path):
            self.note(f"{path.name} {UNFINISHED}: this is the part that is already written")
        if self.bus.damage:
            self.note(f"damaged: {self.bus.damage}")
        self.seek(0.0)

    @property
    def position_s(self) -> float:
        """The position in seconds from the beginning."""
        return self.bus.timeline.position_s

    @property
    def duration_s(self) -> float:
        """The duration in seconds."""
        return self.bus.timeline.duration_ns / NS_PER_S

    @property
    def playing(self) -> bool:
        """True while it plays."""
        return self.bus.timeline.playing

    @property
    def speed(self) -> float:
        """The speed as a factor of real time."""
        return self.bus.timeline.speed

    def note(self, text: str) -> None:
        """Add a line to the station's log."""
        self.station.note(text)

    def poll(self) -> None:
        """Publish what has become due."""
        if self.playing:
            self.bus.advance()
            self.station.poll()

    def play_or_pause(self) -> None:
        """Pause, or play; from the end, play from the beginning."""
        if self.playing:
            self.bus.timeline.pause()
            self.poll_once()
            return
        if self.position_s >= self.duration_s:
            self.seek(0.0)
        self.bus.timeline.play()

    def poll_once(self) -> None:
        """Publish what is due, also when paused."""
        self.bus.advance()
        self.station.poll()

    def faster(self, factor: float) -> None:
        """Multiply the speed."""
        timeline = self.bus.timeline
        playing = timeline.playing
        timeline.play(timeline.speed * factor)
        if not playing:
            timeline.pause()

    def step(self, ticks: int) -> None:
        """Pause, and move by control periods, forward or back."""
        self.bus.timeline.pause()
        self.seek(self.bus.tick_after(self.position_s, ticks))

    def jump(self, seconds: float) -> None:
        """Move by seconds, forward or back."""
        self.seek(self.position_s + seconds)

    def to_mark(self) -> str:
        """Move to the next mark, or from the last to the first; return its text."""
        mark = self.bus.next_mark(self.position_s) or self.bus.next_mark(-1.0)
        if mark is None:
            return "the recording has no marks"
        self.seek(mark.time_s)
        return f"{mark.time_s:.1f} s: {mark.text}"

    def seek(self, time_s: float) -> None:
        """Move to a time; keep playing if it was."""
        time_s = max(0.0, min(self.duration_s, time_s))
        playing = self.playing
        if time_s < self.position_s:
            self.bus.rewind()
            self.station = self._station()
        self.bus.seek(time_s, self.station.poll)
        self.station.poll()
        if playing:
            self.bus.timeline.play()

    def _station(self) -> Station:
        return Station(self.bus, self.bus.robot, self.bus.timeline, self._world)


def world_in_recording(bus: ReplayBus) -> WorldFacts | None:
    """Return the world of a recording, or None when it has none that can be read."""
    with suppress(RemoteError):
        answer = bus.ask(WORLD)
        if isinstance(answer, bytes):
            return parse_world(answer)
    return None


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
            # rarely needed, so imported late

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
