"""Runs driven and recorded here, shown by a station, and compared with ghosts."""

import json
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from checks.harness.messages import make
from ground.client.goal import Destination
from ground.ghost.ghost import Ghost
from ground.recording.log_reader import LoggedFrame, record_bytes
from ground.recording.playback import ReplayBus
from ground.station.station import Station
from ground.station.world import parse_world
from plant.sim.simulation import Plant
from plant.world.file import load
from protocol.outcome import Outcome
from protocol.topics import COMMANDED, COMPONENT, CYCLE, DECISION, ODOMETRY, STATUS, TRUTH, Topic
from protocol.wire.codec import Encoder
from protocol.wire.message import Message
from protocol.wire.messages import CycleReport, GoalRequest
from protocol.world import as_json
from robot import telemetry
from robot.core.values import Outputs
from robot.vehicle import RobotVehicle
from runtime.clock import ManualClock
from study.trial.core_loop import CoreLoop
from study.trial.trial import Trial, run_trial, wire_goal_of

BEGAN_NS = 1_790_000_000_000_000_000
ROBOT = "r1"


@dataclass
class Recording:
    """A log as `ground.recording.log_reader` opens one, and a watch that fills it."""

    facts: dict[str, str] = field(default_factory=dict)
    found: list[LoggedFrame] = field(default_factory=list)
    robot: str = ROBOT
    lost_bytes: int = 0
    share: float = 1.0

    def __call__(self, plant: Plant, onboard: CoreLoop, outputs: Outputs) -> None:
        state, now_ns = onboard.state, plant.now_ns
        zone_m = RobotVehicle.zone_m.fget(onboard)  # type: ignore[attr-defined]
        self.put(TRUTH, plant.truth(), now_ns)
        self.put(ODOMETRY, telemetry.odometry(state, now_ns), now_ns)
        self.put(STATUS, telemetry.status(state, 7, now_ns, onboard.now_ms), now_ns)
        self.put(DECISION, telemetry.decision(outputs, zone_m, now_ns), now_ns)
        self.put(CYCLE, cycle(now_ns), now_ns)

    def put(self, topic: Topic[Any], message: Message, at_ns: int) -> None:
        frame = Encoder(1, COMPONENT[topic.publisher]).encode(message)
        self.found.append(LoggedFrame(BEGAN_NS + at_ns, topic.key(ROBOT), frame))

    def without(self, *topics: Topic[Any]) -> "Recording":
        keys = {topic.key(ROBOT) for topic in topics}
        return Recording(self.facts, [one for one in self.found if one.key not in keys])

    @property
    def records(self) -> int:
        return len(self.found)

    def __iter__(self) -> Iterator[LoggedFrame]:
        return iter(self.found)

    def damage(self) -> str:
        return f"{self.lost_bytes} bytes are lost" if self.lost_bytes else ""

    def written(self, path: Path) -> str:
        """Write a .tlog file; return its path."""
        records = (record_bytes(one.time_ns // 1000, one.frame) for one in self.found)
        path.write_bytes(b"".join(records))
        return str(path)


def cycle(time_ns: int) -> CycleReport:
    return make(
        CycleReport,
        time_ns=time_ns,
        tick=time_ns // 50_000_000,
        budget_us=2500,
        stage_us=(1, 2, 3, 4, 5),
    )


def recorded(trial: Trial) -> tuple[Recording, Outcome]:
    """Write the run with everything that a recorder would store."""
    world, goal = trial.world, wire_goal_of(trial.world)
    facts = {"world": json.dumps(as_json(world, None)), "parameters": "[]"}
    recording = Recording(facts)
    asked = GoalRequest(request_id=7, mode=10, **goal._asdict())
    recording.put(COMMANDED, asked, 0)
    return recording, run_trial(trial, recording)


def box(navigator: str = "vgm", side: str = "left") -> tuple[Recording, Outcome]:
    return recorded(Trial(world=load("box"), navigator=navigator, side=side, noise="none"))


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


def driven(trial: Trial) -> tuple[Outcome, list[tuple[float, float]]]:
    """Outcome of a run, and the true position in each tick."""
    places: list[tuple[float, float]] = []

    def watch(plant: Plant, onboard: CoreLoop, outputs: Outputs) -> None:
        truth = plant.truth()
        places.append((truth.x_m, truth.y_m))

    return run_trial(trial, watch), places


def ghost_in(world: str, navigator: str = "vgm_memory", **more: Any) -> Ghost:
    start = load(world).start
    pose = (start.x_m, start.y_m, start.heading_rad)
    return Ghost(world, pose, 0.0, goal_in(world), navigator, **more)


def goal_in(world: str) -> Destination:
    goal = load(world).goal
    return Destination(x_m=goal.x_m, y_m=goal.y_m, heading_rad=goal.heading_rad)
