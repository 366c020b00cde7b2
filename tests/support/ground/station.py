"""A robot, a plant and a station on a played bus; a test owns time and sets messages."""

import asyncio
import json
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from math import inf, nan
from typing import Any, ClassVar, Self
from weakref import finalize

from checks.harness.loop import PlayedLoop
from checks.harness.messages import make
from ground.station.link.loss import Loss
from ground.station.station import Station
from ground.station.world import WorldFacts
from protocol.bus.network import Hub
from protocol.topic import person_of
from protocol.topics import (
    COMMAND,
    CYCLE,
    DECISION,
    DRIVE,
    HEARTBEAT,
    INPUTS,
    LEASE,
    LEASE_SERVICE,
    MISSION,
    MISSION_SERVICE,
    ODOMETRY,
    OPERATOR,
    PARAMETER,
    PARAMETERS,
    SONAR,
    STATUS,
    STOP,
    SUMMARIES,
    TEXT,
    TRUTH,
    WHEELS,
    WORLD,
    Role,
    Topic,
)
from protocol.wire.codec import Encoder
from protocol.wire.enums import AckResult, Branch, GoalState, LeaseAction, Mode, Vehicle
from protocol.wire.message import Message
from protocol.wire.messages import (
    AvoidanceDecision,
    CommandAck,
    CommandRequest,
    CycleReport,
    GroundTruth,
    Heartbeat,
    LeaseRequest,
    LeaseStatus,
    MissionCount,
    MissionRequestList,
    MissionStatus,
    NavigatorStatus,
    ParamValue,
    PlanarOdometry,
    SonarScan,
    Statustext,
    TickInputs,
    WheelCommand,
    WheelTicks,
)
from protocol.wire.reasons import Reason
from protocol.wire.statustext import pieces_of
from robot.commands import acknowledge
from runtime.clock import ManualClock
from runtime.errors import NoAnswerError
from runtime.units import NS_PER_S as S
from runtime.units import PERIOD_NS
from tests.support.played_bus import PlayedBus

BEAT = make(Heartbeat)


@dataclass
class Lease:
    """The robot's side of it, as short as it can be."""

    holder: str = ""
    name: str = ""
    lapses_ms: int = 3000
    drive_id: int = 0
    driver: str = ""


@dataclass
class Robot:
    """Messages of each period of 50 ms; each part can be switched off."""

    name: str = "r1"
    loop: bool = True
    senses: bool = True
    flags: int = 3
    tick: int = 0
    time_ns: int = 0
    x_m: float = 0.0
    placed: bool = True
    vehicle: Vehicle = Vehicle.ACTIVE
    vehicle_reason: Reason = Reason.NONE
    mode: Mode = Mode.GUIDED
    goal: GoalState = GoalState.NONE
    goal_id: int = 0
    goal_x_m: float = 5.0
    stop_id: int = 0
    rotation_rad: float = 0.0
    lease: Lease = field(default_factory=Lease)

    def said(self) -> list[tuple[Topic[Any], Message]]:
        found: list[tuple[Topic[Any], Message]] = []
        if self.senses:
            found += [(WHEELS, self.wheels()), (SONAR, self.scan()), (TRUTH, self.truth())]
        if self.loop:
            found += self._looped()
            self.tick += 1
        self.time_ns += PERIOD_NS
        return found

    def _looped(self) -> list[tuple[Topic[Any], Message]]:
        stamp = {"time_ns": self.time_ns, "seq": self.tick}
        found: list[tuple[Topic[Any], Message]] = [
            (DRIVE, make(WheelCommand, **stamp, sense_seq=self.tick, ttl_ms=150)),
            (ODOMETRY, self.odometry()),
            (STATUS, self.status()),
            (DECISION, self.decision()),
            (CYCLE, self.cycle()),
            (INPUTS, self.inputs()),
        ]  # fmt: skip
        if self.tick % 4 == 0:
            found.append((HEARTBEAT, BEAT))
        if self.tick % 10 == 0:
            found += [(LEASE, self.lease_status()), (MISSION, self.mission()), *self.summary()]
        return found

    def summary(self) -> list[tuple[Topic[Any], Message]]:
        said: list[tuple[Topic[Any], Message]] = [
            (STATUS, self.status()), (ODOMETRY, self.odometry()),
        ]  # fmt: skip
        if self.flags & 3 != 3:
            said.append((INPUTS, self.inputs()))
        return [(SUMMARIES[topic.path], message) for topic, message in said]

    def wheels(self) -> WheelTicks:
        return WheelTicks(time_ns=self.time_ns, seq=self.tick, left=0, right=0, bumper=0, expired=0)

    def scan(self) -> SonarScan:
        return SonarScan(
            time_ns=self.time_ns,
            seq=self.tick,
            range_mm=(1000,) * 8,
            ping_age_us=(0,) * 8,
            valid=0b0111_1111,
            echo=0b0000_1111,
        )

    def truth(self) -> GroundTruth:
        return make(GroundTruth, time_ns=self.time_ns, seq=self.tick, x_m=self.x_m, clearance_m=1.0)

    def odometry(self) -> PlanarOdometry:
        known = 0.0 if self.placed else nan
        return make(
            PlanarOdometry, time_ns=self.time_ns, x_m=self.x_m, speed_m_s=0.25,
            cov_xx_m2=0.04 + known, cov_xy_m2=known, cov_xh_m_rad=known, cov_yy_m2=0.01 + known,
            cov_yh_m_rad=known, cov_hh_rad2=known,
        )  # fmt: skip

    def status(self) -> NavigatorStatus:
        return make(
            NavigatorStatus, time_ns=self.time_ns, goal_id=self.goal_id, stop_id=self.stop_id,
            goal_x_m=self.goal_x_m, goal_y_m=1.0, goal_heading_rad=nan, goal_distance_m=4.0,
            vehicle=self.vehicle, mode=self.mode, goal=self.goal,
            vehicle_reason=self.vehicle_reason,
        )  # fmt: skip

    def decision(self) -> AvoidanceDecision:
        return make(
            AvoidanceDecision, time_ns=self.time_ns, nearest_bearing_rad=nan, nearest_range_m=inf,
            zone_m=0.3, rotation_rad=self.rotation_rad, virtual_x_m=nan, virtual_y_m=nan,
            speed_m_s=0.2, branch=Branch.TO_GOAL,
        )  # fmt: skip

    def cycle(self) -> CycleReport:
        return make(
            CycleReport, time_ns=self.time_ns, tick=self.tick, late_us=90, budget_us=5000,
            stage_us=(1, 2, 3, 4, 5),
        )  # fmt: skip

    def inputs(self) -> TickInputs:
        return make(TickInputs, time_ns=self.time_ns, tick=self.tick, flags=self.flags)

    def lease_status(self) -> LeaseStatus:
        held = bool(self.lease.holder)
        lease = self.lease
        return LeaseStatus(
            time_ns=self.time_ns, lapses_ms=lease.lapses_ms * held, held=held, holder=lease.holder,
            name=lease.name, drive_id=lease.drive_id, driver=lease.driver,
        )  # fmt: skip

    def mission(self) -> MissionStatus:
        return make(MissionStatus, time_ns=self.time_ns)


PARAMS = {"d_obs_m": 0.3, "side": 1, "op_lost_ms": 1500, "accel_m_s2": 1.25, "v_max_m_s": 0.25}
WORLD_TEXT = b"""{"name": "box", "size_m": [6.0, 4.0], "walls": true,
 "start": {"x_m": 0.6, "y_m": 2.0, "heading_deg": 90.0},
 "goal": {"x_m": 5.4, "y_m": 2.0, "heading_deg": null, "position_tolerance_m": 0.05},
 "obstacles": [{"polygon_m": [[2, 1], [3, 1], [3, 2]]},
  {"wall_m": [[0, 3], [2, 3]], "thickness_m": 0.02},
  {"circle_m": {"x": 4, "y": 3, "radius": 0.25}},
  {"circle_m": {"x": 1, "y": 1, "radius": 0.1}, "path_m": [[1, 1], [1, 3]], "speed_m_s": 0.5}],
 "robot": {"radius_m": 0.15}}"""


class ThreadAtOnce:
    """Does its work when it is started; one whose name is held waits for `Play.work`."""

    held: ClassVar[set[str]] = set()
    waiting: ClassVar[dict[str, Callable[[], object]]] = {}

    def __init__(self, target: Callable[[], object], name: str = "", **_: object) -> None:
        self._target, self._name = target, name

    def start(self) -> None:
        if self._name in self.held:
            self.waiting[self._name] = self._target
        else:
            self._target()


def end(loop: PlayedLoop) -> None:
    """Drop what a loop has not done yet, and close it."""
    for task in asyncio.all_tasks(loop):
        task.cancel()
    loop.advance()
    loop.close()


class Play:
    """`forward` lets time go by in periods of 50 ms; the station is polled in each.

    `turn` lets the event loop do what it can do now.
    """

    def __init__(self, world: WorldFacts | None = None) -> None:
        self.clock = ManualClock(1000 * S)
        self.bus = PlayedBus(self.clock)
        self.robots = [Robot()]
        self.delivered = True
        self.commands: list[CommandRequest] = []
        self.refuses = Reason.NONE
        self.params: dict[str, float] = dict(PARAMS)
        self.bus.come(Role.ROBOT)
        self.bus.come(Role.PLANT)
        for name in ("r1", "r2"):
            self.bus.publisher(STOP, name).heard = partial(self._press, name)
        self._serve()
        self.loop = PlayedLoop(self.clock)
        self.loop.set_exception_handler(lambda _loop, _context: None)
        finalize(self, end, self.loop)
        self.station = Station(
            self.bus,
            "r1",
            self.clock,
            world,
            name="anna",
            begin=self.loop.create_task,
        )

    @property
    def robot(self) -> Robot:
        return self.robots[0]

    @property
    def loss(self) -> Loss:
        """The loss that there must be."""
        loss = self.station.loss()
        assert loss is not None, "nothing is lost"
        return loss

    @property
    def beats(self) -> int:
        """Return the number of heartbeats that the station sent for r1."""
        return len(self.bus.publisher(OPERATOR, "r1").said)

    def forward(self, seconds: float, *, poll: bool = True) -> Self:
        for _ in range(round(seconds * 20)):
            self.turn()
            for robot in self.robots:
                for topic, message in robot.said():
                    (self.bus.say if self.delivered else self.bus.lose)(topic, message, robot.name)
            if poll:
                self.station.poll()
            self.loop.advance(PERIOD_NS)
        return self

    def turn(self) -> None:
        self.loop.advance()

    def hold(self, thread: str) -> None:
        """Let a thread wait that is begun from now on."""
        ThreadAtOnce.held.add(thread)

    def work(self, thread: str) -> None:
        """Let it work, and all later ones of this name."""
        ThreadAtOnce.held.discard(thread)
        if (target := ThreadAtOnce.waiting.pop(thread, None)) is not None:
            target()

    def texts(self, words: str = "") -> list[str]:
        return [line.text for line in self.station.log.find(words)]

    # What happens to others.

    def die(self) -> None:
        self.robot.loop = False
        self.bus.go(Role.ROBOT)
        self.bus.answers.clear()

    def hang(self) -> None:
        self.robot.loop = False
        self.bus.answers.clear()

    def revive(self) -> None:
        self.robot.loop = self.robot.senses = self.delivered = True
        self.bus.linked_by = Hub.PEER
        self.bus.come(Role.ROBOT)
        self.bus.come(Role.PLANT)
        self._serve()

    def cut(self, hub: Hub) -> None:
        """Let no process answer; `outcome` is the result of a call."""
        self.delivered = False
        self.bus.linked_by = hub
        self.bus.answers.clear()
        self.bus.go(Role.ROBOT)
        self.bus.go(Role.PLANT)

    def say(self, text: str, severity: int = 6) -> None:
        for piece in pieces_of(text, 7, severity):
            self.bus.say(TEXT, piece)

    def say_earlier(self, text: str, age_ns: int) -> None:
        """Deliver a text that was published `age_s` ago and is fetched now."""
        frame = Encoder(1, 1).encode(Statustext(severity=6, text=text, id=0, chunk_seq=0))
        self.bus.say_frame(TEXT, frame, at_ns=self.clock.now_ns() - age_ns)

    def _press(self, name: str, request: Message) -> None:
        """Deliver an emergency stop if the robot can be reached and its loop runs."""
        if not (self.robot.loop and self.delivered):
            return
        assert isinstance(request, CommandRequest)
        self.commands.append(request)
        self.robot.vehicle, self.robot.stop_id = Vehicle.EMERGENCY_STOP, request.request_id
        for topic in (STATUS, SUMMARIES[STATUS.path]):
            self.bus.say(topic, self.robot.status(), name)

    # The robot's services.

    def _serve(self) -> None:
        self.bus.answers |= {
            PARAMETERS.path: lambda _: listed(self.params),
            PARAMETER.path: lambda _: make(
                ParamValue, param_id="radius_m", param_value=0.12, param_count=2
            ),
            WORLD.path: lambda _: WORLD_TEXT,
            LEASE_SERVICE.path: self._lease,
            COMMAND.path: self._command,
            MISSION_SERVICE.path: no_items,
        }

    def _lease(self, request: Message | None) -> Message:
        assert isinstance(request, LeaseRequest)
        lease = self.robot.lease
        is_theirs = lease.holder and person_of(lease.holder) != person_of(self.bus.operator)
        if request.action in (LeaseAction.RELEASE, LeaseAction.LEAVE):
            lease.holder = lease.name = ""
        elif request.action == LeaseAction.TAKE and is_theirs:
            return refused(Reason.LEASE_HELD)
        else:
            lease.holder, lease.name = self.bus.operator, request.name
        return CommandAck(command=0, result=AckResult.ACCEPTED, result_param2=0)

    def _command(self, request: Message | None) -> Message:
        assert isinstance(request, CommandRequest)
        self.commands.append(request)
        if self.refuses:
            return refused(self.refuses)
        return acknowledge(request, Reason.NONE)


def listed(params: dict[str, float]) -> bytes:
    """Return a robot's answer to the request for its parameters."""
    rows = [{"name": name, "value": value, "default": value} for name, value in params.items()]
    return json.dumps(rows).encode()


def no_items(request: Message | None) -> Message:
    """Return the answer of a robot without a mission and a fence."""
    assert isinstance(request, MissionRequestList)
    return make(MissionCount, count=0, mission_type=request.mission_type)


def refused(reason: Reason) -> CommandAck:
    return CommandAck(command=0, result=AckResult.DENIED, result_param2=reason)


def silent(_: Message | None) -> Message:
    """Provide a service that never answers."""
    raise NoAnswerError("no answer within 0.25 s")
