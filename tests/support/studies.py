"""Small studies, searches, recorded drives, trials and contacts for tests of the study."""

import json
import multiprocessing
import os
import signal
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from hashlib import sha256
from itertools import pairwise, product
from math import pi
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from ground.recording.mcap_file import McapFormat
from plant.corpus import generate
from plant.model.configuration import LEVELS
from plant.sim.simulation import Plant
from protocol.outcome import RunOutcome
from protocol.topics import (
    ANSWERED,
    COMMANDED,
    DECISION,
    DRIVE,
    INPUTS,
    ODOMETRY,
    SONAR,
    STATUS,
    WHEELS,
    Topic,
    sender_of,
)
from protocol.wire.codec import Encoder
from protocol.wire.enums import Command
from protocol.wire.limits import MAX_WHEEL_TTL_MS
from protocol.wire.message import Message
from protocol.wire.messages import CommandRequest, GoalRequest, WheelCommand
from protocol.wire.reasons import Reason
from protocol.world import Point, World, WorldCircle
from robot import telemetry
from robot.core.parameters import DEFAULTS, Params
from robot.core.states import TO_GOAL
from robot.core.values import Inputs, now_ms_of, scan_of, wheels_of
from robot.core.values import Pose as CorePose
from robot.parameter_table import described, with_values
from robot.storage import Store
from robot.telemetry import CoreInputs
from robot.vehicle import RobotVehicle
from study.calibration import CCW, CW, SquareRun, believed
from study.falsify.climb import SearchCandidate, SearchSettings, Violation, climb
from study.falsify.evaluate import Subject
from study.falsify.properties import Evaluation
from study.report.contact_kinds import StoredPoint, Touched, TracedTick
from study.report.drives import DrivenTrial, Pose
from study.report.trials import Trials, trials_of
from study.runner.plan import ListedWorld, StudySettings, TrialTask, digest_of, tasks_of
from study.runner.rows import CodeVersion, TrialRow
from study.runner.run_task import StudyContext, failed, published_score, spl
from study.runner.store import SCHEMA, table_of
from study.trial.trial import Trial, start_of, wire_goal_of
from tests.support.plant import plain_world

CODE = CodeVersion(commit="c0ffee", dirty=False, version="0.1.0", digest="d1")


def floor(name: str = "floor", *, far_m: float = 0.4, family: str | None = "open") -> World:
    """Return a world with the goal straight ahead, a second or two away."""
    return plain_world(
        name,
        (4.0, 3.0),
        (1.0, 1.0),
        (1.0 + far_m, 1.0),
        family=family,
        shortest_path_m=far_m,
        reachable=True,
    )


def boxed(name: str = "disc") -> World:
    """Return a world with a disc in the way, so that the robot has to avoid it."""
    world = floor(name, far_m=2.4, family="disc")
    return replace(world, obstacles=(WorldCircle(x_m=2.2, y_m=1.0, radius_m=0.2),))


def list_of(*worlds: World) -> list[ListedWorld]:
    return [ListedWorld(f"shipped:{one.name}", digest_of(one), one) for one in worlds]


def context_of(*worlds: World, study: str = "test") -> StudyContext:
    return StudyContext(study=study, code=CODE, worlds=worlds)


def settings(**changed: Any) -> StudySettings:
    usual: dict[str, Any] = {"navigators": ("vgm:left",), "noise": ("none",), "timeout_s": 20.0}
    return StudySettings(**{**usual, **changed})


def tasks(*worlds: World, **changed: Any) -> list[TrialTask]:
    return tasks_of(list_of(*worlds), settings(**changed), CODE.version)


def rows(count: int, start: int = 0, **changed: Any) -> list[TrialRow]:
    """Return rows of different trials, none of them driven."""
    one, context = tasks(floor())[0], context_of(floor())
    made = [
        failed(replace(one, trial_id=f"{number:032x}"), context, "never begun")
        for number in range(start, start + count)
    ]
    return [replace(row, **changed) for row in made]


def ids(found: Any) -> list[str]:
    """Return the trial ids of a table in its order."""
    names: list[str] = found["trial_id"].to_pylist()
    return names


def spoil(file: Path) -> None:
    """Truncate a file, as a failing disk does."""
    whole = file.read_bytes()
    file.write_bytes(whole[: len(whole) // 2])


class Watch:
    """A clock that the test sets."""

    def __init__(self) -> None:
        self.now_s = 100.0

    def __call__(self) -> float:
        return self.now_s


class Deadly(dict[str, float]):
    """Settings that kill the process that reads them, a number of times; each leaves a mark."""

    def __init__(self, marks: Path, times: int) -> None:
        super().__init__()
        self.marks, self.times = marks, times

    def keys(self) -> Any:
        if multiprocessing.parent_process() is not None:
            killed = len(list(self.marks.iterdir()))
            if killed < self.times:
                (self.marks / str(killed)).touch()
                os.kill(os.getpid(), signal.SIGKILL)
        return super().keys()

    def __iter__(self) -> Iterator[str]:
        return iter(self.keys())  # otherwise dict() would bypass keys()


class Faulty(dict[str, float]):
    """Settings that raise when read."""

    def keys(self) -> Any:
        raise RuntimeError("the floor gave way")

    def __iter__(self) -> Iterator[str]:
        return iter(self.keys())  # otherwise dict() would bypass keys()


def deadly(marks: Path, times: int, name: str = "deadly") -> World:
    marks.mkdir(exist_ok=True)
    return replace(floor(name), robot=Deadly(marks, times))


def faulty(name: str = "faulty") -> World:
    return replace(floor(name), robot=Faulty())


ARRIVED = RunOutcome(
    world="w",
    navigator="vgm",
    seed=0,
    noise="none",
    wall_s=0.1,
    outcome="reached",
    reason="",
    time_s=30.0,
    path_m=6.0,
    shortest_path_m=3.0,
    position_error_m=0.01,
    heading_error_rad=None,
    estimated_position_error_m=0.01,
    min_clearance_m=0.2,
    contacts=0,
    own_contacts=0,
    ticks=600,
    missed_ticks=0,
    digest="",
)
STUCK_RUN = replace(ARRIVED, outcome="stuck")


SCENES = ("symmetric_trap", "three_walls", "wedge")


def search_of(navigator: str, properties: str = "abc", seed: int = 1) -> SearchSettings:
    """Return a search in scenes of few walls, without noise; the side may follow a colon."""
    name, _, side = navigator.partition(":")
    subject = Subject(navigator=name, side=side or "left", noise="none", detour=20.0)
    return SearchSettings(subject=subject, properties=properties, families=SCENES, seed=seed)


@cache
def first_violation(settings: SearchSettings, most_trials: int) -> Violation:
    """Return the first violation of a search within a number of trials."""
    number = trials = 0
    while trials < most_trials:
        one = climb(settings, number)
        if one.violations:
            return one.violations[0]
        number, trials = number + 1, trials + one.trials
    raise AssertionError(f"no violation in {trials} trials")


@cache
def evaluation_of(kind: str) -> Evaluation:
    """Return an evaluation of a drive that ended blocked, under any kind."""
    return Evaluation(
        world=generate("wedge", 0, 1),
        seed=3,
        kind=kind,
        violated="a",
        scores={},
        outcome=STUCK_RUN,
        goal_reason=60,
        avoidances=2,
        side_changes=1,
        mahalanobis2=0.5,
        nearest_goal_m=1.25,
        contact_branch=0,
        moved_late_m=0.0,
    )


def violation_of(letter: str, kind: str) -> Violation:
    """Return a violation in a wedge."""
    candidate = SearchCandidate("wedge", {"seed": 3.0})
    return Violation(letter=letter, candidate=candidate, evaluation=evaluation_of(kind))


USUAL: dict[str, Any] = {
    "study": "test",
    "world": "box_1_000",
    "world_source": "corpus:box:1:0",
    "family": "box",
    "navigator": "vgm_memory",
    "side": "left",
    "seed": 0,
    "noise": "default",
    "timeout_s": 300.0,
    "parameters": "{}",
    "calibrated": True,
    "outcome": "reached",
    "reason": "none",
    "goal_state": 5,
    "goal_reason": 0,
    "time_s": 30.0,
    "path_m": 5.5,
    "shortest_path_m": 5.0,
    "reachable": True,
    "lap_m": None,
    "thinnest_wall_m": None,
    "top_speed_m_s": 0.3,
    "position_error_m": 0.05,
    "heading_error_rad": 0.02,
    "estimated_position_error_m": 0.04,
    "min_clearance_m": 0.1,
    "mean_clearance_m": 0.6,
    "contacts": 0,
    "own_contacts": 0,
    "ticks": 600,
    "wall_s": 0.5,
    "cpu_s": 0.4,
    "true_x_m": 5.0,
    "true_y_m": 2.0,
    "true_heading_rad": 0.0,
    "x_m": 5.0,
    "y_m": 2.0,
    "heading_rad": 0.0,
    "cov_xx_m2": 0.01,
    "cov_xy_m2": 0.0,
    "cov_yy_m2": 0.01,
    "cov_hh_rad2": 0.001,
    "mahalanobis2": 1.0,
    "doubt_m": 0.2,
    "turned_rad": 3.0,
    "side_changes": 0,
    "avoidances": 1,
    "ticks_to_goal": 400,
    "ticks_passing_left": 100,
    "ticks_passing_right": 80,
    "ticks_aligning": 20,
    "commit": "c0ffee",
    "dirty": False,
    "version": "0.1.0",
    "python": "3.11.0",
    "numpy": "2.0.0",
    "pymunk": "7.0.0",
    "platform": "Linux",
    "machine": "a processor",
    "started_utc": "2026-01-01T00:00:00+00:00",
}


def row(**changes: Any) -> TrialRow:
    """Return a successful trial with changed values; its id depends on its values."""
    fields = {**USUAL, **changes}
    mark = sha256(repr(sorted(fields.items())).encode()).hexdigest()
    fields.setdefault("world_digest", sha256(fields["world"].encode()).hexdigest())
    arrived = fields["outcome"] == "reached" and not fields["contacts"]
    shortest_m = fields["shortest_path_m"]
    fields.setdefault("spl", spl(arrived, fields["path_m"], shortest_m))
    scored = published_score(arrived, fields["time_s"], shortest_m, fields["top_speed_m_s"])
    fields.setdefault("published_score", scored)
    return TrialRow(**{"trial_id": mark[:32], "digest": mark, **fields})


STUCK: dict[str, Any] = {"outcome": "stuck", "reason": "has come no closer for too long"}
GAVE_UP: dict[str, Any] = {
    "outcome": "unreachable",
    "reason": "unreachable: a closed boundary separates robot and goal",
    "goal_reason": int(Reason.UNREACHABLE),
}
COLLIDED: dict[str, Any] = {"outcome": "collided", "contacts": 1, "own_contacts": 1}
SHUT: dict[str, Any] = {
    "world": "unreachable_1_000",
    "family": "unreachable",
    "reachable": False,
    "world_source": "corpus:unreachable:1:0",
    "shortest_path_m": None,
    "lap_m": 12.0,
}
LOST: dict[str, Any] = {
    "outcome": "lost",
    "reason": "lost: found no way; position doubt 0.42 m",
    "goal_reason": int(Reason.LOST),
    "doubt_m": 0.42,
}


def trials(*rows: TrialRow) -> Trials:
    return trials_of(table_of(list(rows)))


def study(
    navigators: Sequence[str] = ("bug", "vgm", "vgm_memory"),
    noises: Sequence[str] = ("none", "default"),
    failing: bool = True,
) -> pa.Table:
    """Return trials in ten worlds with a path and one without; vgm and bug fail in some."""
    rows: list[TrialRow] = []
    families = ("box", "corner", "u_trap", "forest_dense", "moving")
    for navigator, noise, (place, family), number in product(
        navigators, noises, enumerate(families), range(2)
    ):
        bad = failing and navigator != "vgm_memory" and (place + number) % 3 == 0
        ending = (STUCK, COLLIDED, GAVE_UP)[place % 3] if bad else {}
        name, source = f"{family}_1_{number:03d}", f"corpus:{family}:1:{number}"
        request = {"navigator": navigator, "noise": noise, "world": name, "family": family}
        path_m = 5.2 + 0.1 * place + 0.3 * len(navigator)
        rows.append(row(**{**request, "world_source": source, "path_m": path_m, **ending}))
    rows += [
        row(**{"navigator": navigator, "noise": noise, **SHUT, **GAVE_UP})
        for navigator, noise in product(navigators, noises)
    ]
    return table_of(rows)


def without_values(table: pa.Table) -> pa.Table:
    """Return the table with nulls or NaN wherever the schema allows."""
    nulls = {column.name for column in SCHEMA if column.nullable}
    columns = {}
    for column in SCHEMA:
        values = table.column(column.name)
        if column.name in nulls:
            values = pa.nulls(table.num_rows, column.type)
        elif pa.types.is_floating(column.type):
            values = pa.array([float("nan")] * table.num_rows, column.type)
        columns[column.name] = values
    return pa.table(columns)


def drive(
    path: Sequence[Pose],
    branches: Sequence[int] | None = None,
    *,
    world: World | None = None,
    outcome: str = "reached",
    contacts: int = 0,
    **request: Any,
) -> DrivenTrial:
    """Return a drive along these poses, with a perfect estimate."""
    place = world or floor(far_m=2.0)
    trial = Trial(world=place, **{"navigator": "vgm", "noise": "none", **request})
    return DrivenTrial(
        trial=trial,
        outcome=ended(trial, path, outcome, contacts),
        true=tuple(path),
        believed=tuple(path),
        branches=tuple(branches or [1] * len(path)),
        covariance=(0.01, 0.0, 0.04),
    )


def ended(trial: Trial, path: Sequence[Pose], outcome: str, contacts: int) -> RunOutcome:
    """Return the outcome of a trial along this path."""
    way_m = sum(abs(complex(b[0] - a[0], b[1] - a[1])) for a, b in pairwise(path))
    return RunOutcome(
        world=trial.world.name,
        navigator=trial.navigator,
        seed=trial.seed,
        noise=str(trial.noise),
        wall_s=0.1,
        outcome=outcome,
        reason="none",
        time_s=10.0,
        path_m=way_m,
        shortest_path_m=trial.world.shortest_path_m,
        position_error_m=0.0,
        heading_error_rad=None,
        estimated_position_error_m=0.0,
        min_clearance_m=0.2,
        contacts=contacts,
        own_contacts=contacts,
        ticks=len(path),
        missed_ticks=0,
        digest="d1",
    )


RADIUS_M = 0.12
ORIGIN = CorePose(0.0, 0.0, 0.0)
NO_ECHO = (None,) * 8
AHEAD = Touched("wall of 2 mm", (RADIUS_M, 0.0), is_edge=True)


def tick(time_s: float, **changes: Any) -> TracedTick:
    """Return a tick of a robot at the origin that has measured and remembered nothing."""
    usual: dict[str, Any] = {
        "true": ORIGIN,
        "estimated": ORIGIN,
        "clearance_m": 0.1,
        "branch": TO_GOAL,
        "guard": 0,
        "speed_m_s": 0.3,
        "yaw_rate_rad_s": 0.0,
        "range_m": NO_ECHO,
        "points": (),
    }
    return TracedTick(time_s=time_s, **{**usual, **changes})


def stored(x_m: float, y_m: float = 0.0, counts: bool = True) -> dict[str, Any]:
    """Return the change of a tick that remembers one point."""
    return {"points": (StoredPoint(x_m, y_m, counts),)}


def echo(sonar: int, range_m: float) -> dict[str, Any]:
    """Return the change of a tick in which one sonar has an echo."""
    ranges: list[float | None] = [None] * 8
    ranges[sonar] = range_m
    return {"range_m": tuple(ranges)}


def person(start: Point, end: Point) -> WorldCircle:
    """Return a person who walks at 0.1 m/s."""
    return WorldCircle(x_m=start[0], y_m=start[1], radius_m=0.2, path_m=(start, end), speed_m_s=0.1)


NS_PER_MS = 1_000_000
UTC_US = 1_790_000_000_000_000
ARM = CommandRequest(request_id=1, param1=1.0, param2=0.0, command=Command.COMPONENT_ARM_DISARM)


@dataclass
class ScriptedDrive:
    """A drive whose `frames`, with their keys, a test may remove or change."""

    world: World = field(default_factory=boxed)
    params: Params = DEFAULTS
    frames: list[tuple[str, bytes]] = field(default_factory=list)
    _encoders: dict[str, Encoder] = field(default_factory=dict)
    _requests: int = 0

    def add(self, topic: Topic[Message], message: Message) -> None:
        sender = Encoder(*sender_of(topic.publisher, "r1"))
        frame = self._encoders.setdefault(topic.path, sender).encode(message)
        self.frames.append((topic.key("r1"), frame))

    def places_of(self, topic: Topic[Message]) -> list[int]:
        """Return the places of a topic's frames in `frames`."""
        return [place for place, (key, _) in enumerate(self.frames) if key == topic.key("r1")]

    def send(self, vehicle: RobotVehicle, request: Message, now_ns: int) -> None:
        self.add_request(request, vehicle.receive(request, now_ns))

    def add_request(self, request: Message, answer: Message) -> None:
        self._requests += 1
        self.add(COMMANDED, request)
        self.add(ANSWERED, answer)

    def goal(self) -> GoalRequest:
        goal = wire_goal_of(self.world)._asdict()
        return GoalRequest(request_id=2, mode=10, **goal)

    def run(
        self,
        ticks: int = 160,
        wait: int = 4,
        store: Store | None = None,
        asked: Sequence[Message] = (),
    ) -> "ScriptedDrive":
        """Drive: after `wait` ticks at rest the robot is armed and given the world's goal.

        The requests in `asked` are sent in the second tick.
        """
        plant = Plant(self.world, 0, LEVELS["default"])
        vehicle = RobotVehicle(self.params, store or Store(None), start_of(self.world))
        for request, answer in vehicle.restore():
            self.add_request(request, answer)
        for tick in range(ticks):
            for one in asked if tick == 1 else ():
                self.send(vehicle, one, plant.now_ns)
            if tick == wait:
                self.send(vehicle, ARM, plant.now_ns)
                self.send(vehicle, self.goal(), plant.now_ns + 3 * NS_PER_MS)
            self._tick(plant, vehicle, tick)
            plant.advance()
        return self

    def _tick(self, plant: Plant, vehicle: RobotVehicle, tick: int) -> None:
        now_ns = plant.now_ns
        wheels, scan = plant.senses()
        assert wheels is not None
        assert scan is not None
        self.add(WHEELS, wheels)
        self.add(SONAR, scan)
        inputs = Inputs(now_ms_of(now_ns), wheels_of(wheels), scan_of(scan, 0), None)
        outputs = vehicle.step(inputs, lambda _stage: None)
        left, right = outputs.left_mrad_s, outputs.right_mrad_s
        plant.command(0, left, right, MAX_WHEEL_TTL_MS)
        command = WheelCommand(
            time_ns=now_ns,
            seq=tick,
            sense_seq=scan.seq,
            left_mrad_s=left,
            right_mrad_s=right,
            ttl_ms=MAX_WHEEL_TTL_MS,
        )
        self.add(DRIVE, command)
        self.add(ODOMETRY, telemetry.odometry(vehicle.state, now_ns))
        goal_id, stop_id = vehicle.commands.goal_id, vehicle.commands.take_shown_stop()
        self.add(STATUS, telemetry.status(vehicle.state, goal_id, now_ns, inputs.now_ms, stop_id))
        self.add(DECISION, telemetry.decision(outputs, vehicle.zone_m, now_ns))
        given = CoreInputs(wheels.seq, scan.seq, 0, self._requests, 0)
        self.add(INPUTS, telemetry.tick_inputs(inputs, given, None, tick, now_ns))

    def write(self, path: Path, **facts: str) -> Path:
        """Write an .mcap with the robot's parameters and start."""
        form = McapFormat("r1", {})
        start = self.world.start
        place = {"x_m": start.x_m, "y_m": start.y_m, "heading_deg": start.heading_rad * 180.0 / pi}
        usual = {
            "parameters": json.dumps(described(self.params)),
            "world": json.dumps({"name": "boxed", "start": place}),
        }
        for name, text in (usual | facts).items():
            if text:
                form.add_fact(name, text)
        for number, (key, frame) in enumerate(self.frames):
            form.add(key, frame, UTC_US + number * 5000)
        path.write_bytes(form.end())
        return path


STEPS = 100  # keeps wheel increments below the odometry's limit per period
SIDE_M = 4.0


def squares(
    truth: dict[str, float], count: int, slip_m: float = 0.0, seed: int = 0, side_m: float = SIDE_M
) -> list[SquareRun]:
    """Return runs of a robot with the parameters `truth` that steers with the defaults."""
    rng = np.random.default_rng(seed)
    real = with_values(DEFAULTS, truth)
    return [
        square(direction, real, slip_m, rng, side_m)
        for direction in (CW, CCW)
        for _ in range(count)
    ]


def square(
    direction: str, real: Params, slip_m: float, rng: np.random.Generator, side_m: float
) -> SquareRun:
    turn = 1 if direction == CCW else -1
    side = round(side_m / STEPS / DEFAULTS.m_per_tick)
    corner = round(0.25 * pi * DEFAULTS.track_m / 10 / DEFAULTS.m_per_tick)
    steps = ([(side, side)] * STEPS + [(-turn * corner, turn * corner)] * 10) * 4
    phase = rng.integers(0, 1000, 2)
    ticks = np.vstack([phase, phase + np.cumsum(steps, axis=0)])
    run = SquareRun(
        direction=direction,
        ticks=[(int(left), int(right)) for left, right in ticks],
        measured=CorePose(0.0, 0.0, 0.0),
    )
    if slip_m == 0.0:
        return SquareRun(direction=direction, ticks=run.ticks, measured=believed(run, real).pose)
    return SquareRun(direction=direction, ticks=run.ticks, measured=slipped(run, real, slip_m, rng))


def slipped(run: SquareRun, real: Params, slip_m: float, rng: np.random.Generator) -> CorePose:
    """Return the end when each wheel slips with a variance of `slip_m` per metre."""
    shares = np.array([2.0 / (real.wheel_ratio + 1.0), 2.0 / (1.0 / real.wheel_ratio + 1.0)])
    ways = np.diff(np.array(run.ticks), axis=0) * real.m_per_tick * shares
    ways = ways + rng.normal(size=ways.shape) * np.sqrt(slip_m * np.abs(ways))
    turns = (ways[:, 1] - ways[:, 0]) / real.track_m
    middles = np.cumsum(turns) - 0.5 * turns
    steps = ways.mean(axis=1)
    x_m, y_m = float(steps @ np.cos(middles)), float(steps @ np.sin(middles))
    heading_rad = float((turns.sum() + pi) % (2.0 * pi) - pi)
    return CorePose(x_m, y_m, heading_rad)
