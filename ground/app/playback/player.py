"""A recording with a station that looks at it: it plays, steps and seeks, also backwards."""

from contextlib import suppress
from pathlib import Path

from ground.recording.playback.playback_bus import ReplayBus
from ground.station import Station
from ground.station.world import WorldFacts, world_in
from protocol.topics import WORLD
from runtime.clock import Clock
from runtime.errors import RemoteError
from runtime.units import NS_PER_S


class Player:
    """`station` is another one after every way back: what was seen later is not known yet."""

    def __init__(self, path: Path, clock: Clock, robot: str | None = None) -> None:
        """UserError when there is nothing to play."""
        self.bus = ReplayBus(path, clock, robot)
        self._world = world_in_recording(self.bus)
        self.station = self._station()
        self.note(f"{path.name}: {self.duration_s:.1f} s of {self.bus.robot}")
        if self.bus.damage:
            self.note(f"damaged: {self.bus.damage}")
        self.seek(0.0)

    @property
    def position_s(self) -> float:
        return self.bus.timeline.position_s

    @property
    def duration_s(self) -> float:
        return self.bus.timeline.duration_ns / NS_PER_S

    @property
    def playing(self) -> bool:
        return self.bus.timeline.playing

    @property
    def speed(self) -> float:
        return self.bus.timeline.speed

    def note(self, text: str) -> None:
        self.station.note(text)

    def poll(self) -> None:
        """Hand on what has become due."""
        if self.playing:
            self.bus.advance()
            self.station.poll()

    def play_or_pause(self) -> None:
        """From the end it plays from the beginning."""
        if self.playing:
            self.bus.timeline.pause()
            self.poll_once()
            return
        if self.position_s >= self.duration_s:
            self.seek(0.0)
        self.bus.timeline.play()

    def poll_once(self) -> None:
        self.bus.advance()
        self.station.poll()

    def faster(self, factor: float) -> None:
        timeline = self.bus.timeline
        playing = timeline.playing
        timeline.play(timeline.speed * factor)
        if not playing:
            timeline.pause()

    def step(self, ticks: int) -> None:
        """One control period on or back, standing."""
        self.bus.timeline.pause()
        self.seek(self.bus.tick_after(self.position_s, ticks))

    def jump(self, seconds: float) -> None:
        self.seek(self.position_s + seconds)

    def to_mark(self) -> str:
        """To the next mark, or from the last one to the first; what it says."""
        mark = self.bus.next_mark(self.position_s) or self.bus.next_mark(-1.0)
        if mark is None:
            return "there are no marks"
        self.seek(mark.time_s)
        return f"{mark.time_s:.1f} s: {mark.text}"

    def seek(self, time_s: float) -> None:
        """To that instant, playing on if it played."""
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
    """None when it holds none, or none that can be read."""
    with suppress(RemoteError):
        answer = bus.ask(WORLD)
        if isinstance(answer, bytes):
            return world_in(answer)
    return None
