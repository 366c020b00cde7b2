"""Drives without a plant or recorded as by a robot process, for re-execution and calibration."""

import json
from collections.abc import Sequence
from dataclasses import dataclass, field
from math import pi
from pathlib import Path

import numpy as np

from ground.recording.mcap_file import McapFormat
from plant.model.configuration import LEVELS
from plant.sim.simulation import Plant
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
from protocol.world import World
from robot import telemetry
from robot.core.parameters import DEFAULTS, Params
from robot.core.values import Inputs, Pose, now_ms_of, scan_of, wheels_of
from robot.parameter_table import described, with_values
from robot.storage import Store
from robot.telemetry import CoreInputs
from robot.vehicle import RobotVehicle
from study.calibration import CCW, CW, SquareRun, believed
from study.trial.trial import start_of, wire_goal_of
from tests.support.study.made import boxed

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
        measured=Pose(0.0, 0.0, 0.0),
    )
    if slip_m == 0.0:
        return SquareRun(direction=direction, ticks=run.ticks, measured=believed(run, real).pose)
    return SquareRun(direction=direction, ticks=run.ticks, measured=slipped(run, real, slip_m, rng))


def slipped(run: SquareRun, real: Params, slip_m: float, rng: np.random.Generator) -> Pose:
    """Return the end when each wheel slips with a variance of `slip_m` per metre."""
    shares = np.array([2.0 / (real.wheel_ratio + 1.0), 2.0 / (1.0 / real.wheel_ratio + 1.0)])
    ways = np.diff(np.array(run.ticks), axis=0) * real.m_per_tick * shares
    ways = ways + rng.normal(size=ways.shape) * np.sqrt(slip_m * np.abs(ways))
    turns = (ways[:, 1] - ways[:, 0]) / real.track_m
    middles = np.cumsum(turns) - 0.5 * turns
    steps = ways.mean(axis=1)
    x_m, y_m = float(steps @ np.cos(middles)), float(steps @ np.sin(middles))
    heading_rad = float((turns.sum() + pi) % (2.0 * pi) - pi)
    return Pose(x_m, y_m, heading_rad)
