"""A recording of a test on a station, as the app plays it."""

import json
from pathlib import Path

from ground.recording.playback import ReplayBus
from ground.station.station import Station
from ground.station.world import parse_world
from plant.world.file import load
from protocol.world import as_json
from runtime.clock import ManualClock
from tests.support.ground.recordings import Recording

WORLD = parse_world(json.dumps(as_json(load("box"), None)))


class Show:
    """A played recording at one of its instants."""

    def __init__(self, run: Recording, folder: Path, at_s: float, world: bool = True) -> None:
        log = Path(run.written(folder / "20260101T000000Z-r1.tlog"))
        self.bus = ReplayBus(log, ManualClock())
        self._world = WORLD if world else None
        self.open()
        self.go(at_s)

    def open(self) -> None:
        """Return a new station, as after every rewind."""
        self.station = Station(self.bus, "r1", self.bus.timeline, self._world)

    def go(self, at_s: float) -> None:
        self.bus.seek(at_s)
        self.station.poll()
