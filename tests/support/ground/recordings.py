"""Decisions, and runs driven here: watched, recorded, shown by a station, beside their ghosts."""

import json
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from itertools import pairwise
from math import nan, radians
from pathlib import Path
from typing import Any, NamedTuple

from checks.harness.messages import make
from ground.client.goal import Destination
from ground.explain import TurningPoint, turning_point
from ground.ghost import Ghost
from ground.recording.log_reader import LoggedFrame, record_bytes
from ground.recording.playback import ReplayBus
from ground.station.station import Station
from ground.station.world import parse_world
from plant.sim.simulation import Plant
from plant.world.file import load
from protocol.outcome import RunOutcome
from protocol.topics import COMMANDED, COMPONENT, CYCLE, DECISION, ODOMETRY, STATUS, TRUTH, Topic
from protocol.wire.codec import Encoder
from protocol.wire.enums import Branch, GoalState, Mode
from protocol.wire.message import Message
from protocol.wire.messages import AvoidanceDecision, CycleReport, GoalRequest, NavigatorStatus
from protocol.world import as_json
from robot import telemetry
from robot.core.values import Outputs
from robot.vehicle import RobotVehicle
from runtime.clock import ManualClock
from runtime.units import PERIOD_NS
from study.trial.core_loop import CoreLoop
from study.trial.trial import Trial, run_trial, wire_goal_of

TEN_S = 10_000_000_000


def decided(**changes: float) -> AvoidanceDecision:
    """Return a decision to pass an obstacle at the left on its right, with `changes`."""
    seen = {"nearest_bearing_rad": radians(33.75), "nearest_range_m": 0.21, "zone_m": 0.30}
    goal = {"goal_bearing_rad": radians(10.0), "rotation_rad": radians(-66.0)}
    virtual = {"virtual_x_m": 4.25, "virtual_y_m": 1.5, "branch": Branch.PASS_RIGHT}
    motion = {"time_ns": TEN_S, "speed_m_s": 0.12, "yaw_rate_rad_s": radians(-80.0)}
    return make(AvoidanceDecision, **(seen | goal | virtual | motion | changes))


def standing(**changes: float) -> NavigatorStatus:
    """Return a status of a drive to a goal in AUTO with vgm, with `changes`."""
    goal = {"goal_id": 1, "goal_x_m": 5.0, "goal_y_m": 2.0, "goal_heading_rad": nan}
    drive = {"mode": Mode.AUTO, "goal": GoalState.AVOIDING, "goal_distance_m": 3.2}
    return make(NavigatorStatus, **({"time_ns": TEN_S} | goal | drive | changes))


def cycle(**changes: int) -> CycleReport:
    rest = {"time_ns": TEN_S, "tick": 200, "late_us": 400, "sense_age_us": 1500}
    stage_us = (50, 100, 200, 40, 10)
    return make(CycleReport, **({"budget_us": 10_000} | rest | changes), stage_us=stage_us)


def turning_points(decisions: Iterable[AvoidanceDecision]) -> list[TurningPoint]:
    """Return the turning points in the order of the run, without the first decision."""
    found = (turning_point(before, after) for before, after in pairwise(decisions))
    return [point for point in found if point is not None]


WORLDS = ("box", "u_trap", "forest_medium")
TIMEOUT_S = 60.0


class Moment(NamedTuple):
    """One tick; `yaw_rate_rad_s` is what the wheels made of it until the next one."""

    decision: AvoidanceDecision
    status: NavigatorStatus
    yaw_rate_rad_s: float


def drive(world: str, navigator: str, noise: str = "none") -> list[Moment]:
    """Return all ticks of a drive but the last, whose successor is unknown."""
    told: list[tuple[AvoidanceDecision, NavigatorStatus]] = []
    yaw_rates: list[float] = []

    def watch(plant: Plant, onboard: CoreLoop, outputs: Outputs) -> None:
        zone_m = RobotVehicle.zone_m.fget(onboard)  # type: ignore[attr-defined]
        decision = telemetry.decision(outputs, zone_m, plant.now_ns)
        status = telemetry.status(onboard.state, 1, plant.now_ns, onboard.now_ms)
        told.append((decision, status))
        yaw_rates.append(plant.truth().yaw_rate_rad_s)

    trial = Trial(world=load(world), navigator=navigator, noise=noise, timeout_s=TIMEOUT_S)
    run_trial(trial, watch)
    return [Moment(*one, yaw) for one, yaw in zip(told, yaw_rates[1:], strict=False)]


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
        tick, stages = now_ns // PERIOD_NS, (1, 2, 3, 4, 5)
        report = {"time_ns": now_ns, "tick": tick, "budget_us": 2500, "stage_us": stages}
        self.put(CYCLE, make(CycleReport, **report), now_ns)

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


def recorded(trial: Trial) -> tuple[Recording, RunOutcome]:
    """Write the run with everything that a recorder would store."""
    world, goal = trial.world, wire_goal_of(trial.world)
    facts = {"world": json.dumps(as_json(world, None)), "parameters": "[]"}
    recording = Recording(facts)
    asked = GoalRequest(request_id=7, mode=10, **goal._asdict())
    recording.put(COMMANDED, asked, 0)
    return recording, run_trial(trial, recording)


def box(navigator: str = "vgm", side: str = "left") -> tuple[Recording, RunOutcome]:
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


def driven(trial: Trial) -> tuple[RunOutcome, list[tuple[float, float]]]:
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
