"""A drive in this process, recorded as the robot's process would have it recorded."""

import json
from collections.abc import Sequence
from dataclasses import dataclass, field
from math import pi
from pathlib import Path

from ground.recording.mcap.writer import McapFormat
from plant.model.noise import LEVELS
from plant.model.types import World
from plant.sim.simulation import Plant
from protocol.sender import sender_of
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
)
from protocol.wire.codec import Encoder
from protocol.wire.enums import Command
from protocol.wire.limits import MAX_WHEEL_TTL_MS
from protocol.wire.message import Message
from protocol.wire.messages import CommandRequest, GoalRequest, WheelCommand
from robot import telemetry
from robot.core.parameters import DEFAULTS, Params
from robot.core.perception.from_messages import now_ms_of, scan_of, wheels_of
from robot.core.values import Inputs
from robot.parameters.table import described
from robot.storage.files import Store
from robot.telemetry import CoreInputs
from robot.vehicle import Vehicle
from study.trial.trial import start_of, wire_goal_of
from tests.support.study.made import boxed

NS_PER_MS = 1_000_000
UTC_US = 1_790_000_000_000_000
ARM = CommandRequest(request_id=1, param1=1.0, param2=0.0, command=Command.COMPONENT_ARM_DISARM)


@dataclass
class Drive:
    """`said` is every frame with its key; a test may take some away, or change one."""

    world: World = field(default_factory=boxed)
    params: Params = DEFAULTS
    said: list[tuple[str, bytes]] = field(default_factory=list)
    _encoders: dict[str, Encoder] = field(default_factory=dict)
    _requests: int = 0

    def say(self, topic: Topic[Message], message: Message) -> None:
        sender = Encoder(*sender_of(topic.publisher, "r1"))
        frame = self._encoders.setdefault(topic.path, sender).encode(message)
        self.said.append((topic.key("r1"), frame))

    def on(self, topic: Topic[Message]) -> list[int]:
        """Places of a topic's frames in `said`."""
        return [place for place, (key, _) in enumerate(self.said) if key == topic.key("r1")]

    def ask(self, vehicle: Vehicle, request: Message, now_ns: int) -> None:
        self.tell(request, vehicle.receive(request, now_ns))

    def tell(self, request: Message, answer: Message) -> None:
        self._requests += 1
        self.say(COMMANDED, request)
        self.say(ANSWERED, answer)

    def goal(self) -> GoalRequest:
        goal = wire_goal_of(self.world)._asdict()
        return GoalRequest(request_id=2, mode=10, **goal)

    def run(
        self,
        ticks: int = 160,
        wait: int = 4,
        store: Store | None = None,
        asked: Sequence[Message] = (),
    ) -> "Drive":
        """It stands for some ticks before it is armed and given the world's goal; `asked`: of it
        after the first of them."""
        plant = Plant(self.world, 0, LEVELS["default"])
        vehicle = Vehicle(self.params, store or Store(None), start_of(self.world))
        for request, answer in vehicle.restore():
            self.tell(request, answer)
        for tick in range(ticks):
            for one in asked if tick == 1 else ():
                self.ask(vehicle, one, plant.now_ns)
            if tick == wait:
                self.ask(vehicle, ARM, plant.now_ns)
                self.ask(vehicle, self.goal(), plant.now_ns + 3 * NS_PER_MS)
            self._tick(plant, vehicle, tick)
            plant.advance()
        return self

    def _tick(self, plant: Plant, vehicle: Vehicle, tick: int) -> None:
        now_ns = plant.now_ns
        wheels, scan = plant.senses()
        assert wheels is not None
        assert scan is not None
        self.say(WHEELS, wheels)
        self.say(SONAR, scan)
        inputs = Inputs(now_ms_of(now_ns), wheels_of(wheels), scan_of(scan, 0), None)
        outputs = vehicle.step(inputs, lambda _stage: None)
        left, right = outputs.left_mrad_s, outputs.right_mrad_s
        plant.command(0, left, right, MAX_WHEEL_TTL_MS)
        told = WheelCommand(
            time_ns=now_ns,
            seq=tick,
            sense_seq=scan.seq,
            left_mrad_s=left,
            right_mrad_s=right,
            ttl_ms=MAX_WHEEL_TTL_MS,
        )
        self.say(DRIVE, told)
        self.say(ODOMETRY, telemetry.odometry(vehicle.state, now_ns))
        goal_id = vehicle.commands.goal_id
        self.say(STATUS, telemetry.status(vehicle.state, goal_id, now_ns, inputs.now_ms))
        self.say(DECISION, telemetry.decision(outputs, vehicle.zone_m, now_ns))
        given = CoreInputs(wheels.seq, scan.seq, 0, self._requests, 0)
        self.say(INPUTS, telemetry.tick_inputs(inputs, given, None, tick, now_ns))

    def written(self, path: Path, **facts: str) -> Path:
        """As an .mcap, with the parameters and the start that the robot had."""
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
        for number, (key, frame) in enumerate(self.said):
            form.add(key, frame, UTC_US + number * 5000)
        path.write_bytes(form.end())
        return path
