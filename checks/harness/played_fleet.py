"""Play the topics of many robots at their rates on one session, without plant and controllers.

The robots drive to and fro in the aisles of a hall. What no process subscribes to is not encoded:
it would not leave this process either. A robot that is stopped stands until it is released.
"""

import json
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from math import inf, nan, pi
from threading import Event, Thread
from time import monotonic_ns
from typing import Any, Final

from checks.harness.messages import make
from protocol.bus.bus import Bus, open_bus
from protocol.bus.network import Network
from protocol.bus.services import ServiceRequest, refusal
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
    PARAMETER,
    PARAMETERS,
    SONAR,
    STATUS,
    SUMMARIES,
    TEXT,
    TRUTH,
    WHEELS,
    WORLD,
    Role,
    Service,
    Topic,
)
from protocol.wire.codec import decode
from protocol.wire.enums import GoalState, Mode, Severity, Vehicle
from protocol.wire.message import Message
from protocol.wire.messages import (
    AvoidanceDecision,
    CommandAck,
    CommandRequest,
    CycleReport,
    GroundTruth,
    Heartbeat,
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
from robot.core import reasons
from robot.core.parameters import DEFAULTS
from runtime.errors import RemoteError
from runtime.units import NS_PER_S, PERIOD_NS, PERIOD_S

HALL_M: Final = (44.0, 30.0)
AISLES: Final = 10
SPEED_M_S: Final = 0.3
LEG_M: Final = 3.0
"""Length of the way that each robot drives to and fro."""
TEXT_TICKS: Final = 400
"""Ticks between two texts of a robot."""
BEAT_TICKS: Final = 4
RARE_TICKS: Final = 10

HALL: Final = json.dumps(
    {
        "name": "hall",
        "size_m": HALL_M,
        "walls": True,
        "start": {"x_m": 2.0, "y_m": 1.5, "heading_deg": 0.0},
        "goal": {"x_m": 40.0, "y_m": 28.0, "heading_deg": None, "position_tolerance_m": 0.05},
        "obstacles": [
            {"polygon_m": [[x, y], [x + 17.0, y], [x + 17.0, y + 0.8], [x, y + 0.8]]}
            for x in (2.5, 24.0)
            for y in (2.6 + 2.8 * row for row in range(AISLES - 1))
        ],
        "robot": {"radius_m": 0.15},
    }
).encode()
LIMITS: Final = json.dumps(
    [{"name": name, "value": value, "default": value} for name, value in DEFAULTS._asdict().items()]
).encode()


class PlayedRobot:
    """One robot and its plant; `vehicle` and `goal` may be set."""

    def __init__(self, bus: Bus, number: int) -> None:
        self.bus, self.name = bus, bus.robot
        self.vehicle, self.goal = Vehicle.ACTIVE, GoalState.DRIVING
        self.is_silent = False
        self._left_m = 2.0 + LEG_M * 1.35 * (number // AISLES)
        self._y_m = 1.5 + 2.8 * (number % AISLES)
        self.ticks, self._number, self._phase = 0, number, 37 * number
        self._stop_id = 0
        self._shown = self.vehicle, self.goal
        topics: tuple[Topic[Any], ...] = (
            *(WHEELS, SONAR, TRUTH, DRIVE, ODOMETRY, STATUS, DECISION, CYCLE, INPUTS),
            *(HEARTBEAT, LEASE, MISSION, TEXT, *SUMMARIES.values()),
        )
        self._publishers = {topic.path: bus.publisher(topic) for topic in topics}
        self._heard: frozenset[str] = frozenset()
        self._serve()

    def look(self) -> None:
        """Note which topics have a subscriber."""
        publishers = self._publishers.items()
        self._heard = frozenset(path for path, one in publishers if one.matched) | {TEXT.path}

    def tick(self) -> None:
        """Publish the messages of one control period."""
        if self.is_silent:
            return
        self.ticks += 1
        if self.vehicle is Vehicle.ACTIVE:
            self._phase += 1
        for topic, message in self._due():
            self._publishers[topic.path].put(message)

    def _due(self) -> Iterator[tuple[Topic[Any], Message]]:
        """Yield the messages of a tick that anybody receives."""
        heard, tick = self._heard, self.ticks + self._number
        for topic, build in self._streams():
            if topic.path in heard:
                yield topic, build()
        if tick % BEAT_TICKS == 0 and HEARTBEAT.path in heard:
            yield HEARTBEAT, make(Heartbeat)
        if tick % RARE_TICKS == 0 and LEASE.path in heard:
            yield LEASE, make(LeaseStatus, time_ns=self._time_ns, holder="", name="", driver="")
        if tick % RARE_TICKS == 0 and MISSION.path in heard:
            yield MISSION, make(MissionStatus, time_ns=self._time_ns)
        if tick % RARE_TICKS == 0 or self._shown != (self.vehicle, self.goal):
            self._shown = self.vehicle, self.goal
            said = {STATUS: self.status, ODOMETRY: self.odometry}
            for topic, build in said.items():
                if (summary := SUMMARIES[topic.path]).path in heard:
                    yield summary, build()
        if tick % TEXT_TICKS == 0:
            text = f"goal {self._x_m:.1f} {self._y_m:.1f} accepted"
            yield TEXT, Statustext(severity=Severity.INFO, text=text, id=0, chunk_seq=0)

    def _streams(self) -> tuple[tuple[Topic[Any], Any], ...]:
        stamp = {"time_ns": self._time_ns}
        number = {**stamp, "seq": self.ticks}
        near_mm = tuple(600 + (self.ticks * (3 + sonar)) % 1500 for sonar in range(8))
        return (
            (WHEELS, partial(make, WheelTicks, **number)),
            (SONAR, partial(make, SonarScan, **number, range_mm=near_mm, echo=255)),
            (TRUTH, partial(make, GroundTruth, **number, x_m=self._x_m, y_m=self._y_m)),
            (DRIVE, partial(make, WheelCommand, **number, ttl_ms=150)),
            (ODOMETRY, self.odometry),
            (STATUS, self.status),
            (DECISION, partial(make, AvoidanceDecision, **stamp, nearest_range_m=inf)),
            (CYCLE, partial(make, CycleReport, **stamp, tick=self.ticks, budget_us=5000)),
            (INPUTS, self.inputs),
        )

    @property
    def _time_ns(self) -> int:
        return self.ticks * PERIOD_NS

    @property
    def _x_m(self) -> float:
        gone_m = self._phase * SPEED_M_S * PERIOD_S % (2.0 * LEG_M)
        return self._left_m + min(gone_m, 2.0 * LEG_M - gone_m)

    def odometry(self) -> Message:
        """Return the pose: to and fro at full speed."""
        back = self._phase * SPEED_M_S * PERIOD_S % (2.0 * LEG_M) > LEG_M
        return make(
            PlanarOdometry, time_ns=self._time_ns, x_m=self._x_m, y_m=self._y_m,
            heading_rad=pi if back else 0.0, speed_m_s=SPEED_M_S * (self.vehicle is Vehicle.ACTIVE),
            cov_xx_m2=1e-3, cov_yy_m2=1e-3, cov_hh_rad2=1e-3,
        )  # fmt: skip

    def status(self) -> Message:
        """Return the state of a robot on its way."""
        return make(
            NavigatorStatus, time_ns=self._time_ns, goal_started_ns=1, goal_id=7,
            stop_id=self._stop_id, goal_x_m=self._left_m + LEG_M, goal_y_m=self._y_m,
            goal_heading_rad=nan, goal_distance_m=self._left_m + LEG_M - self._x_m,
            vehicle=self.vehicle, mode=Mode.AUTO, goal=self.goal,
        )  # fmt: skip

    def inputs(self) -> Message:
        """Return that wheel ticks and a scan were there."""
        return make(TickInputs, time_ns=self._time_ns, tick=self.ticks, flags=3)

    # The services.

    def _serve(self) -> None:
        bus = self.bus
        self._answer(PARAMETERS, lambda _: LIMITS)
        self._answer(PARAMETER, lambda _: make(ParamValue, param_id="radius_m", param_value=0.15))
        self._answer(LEASE_SERVICE, lambda _: make(CommandAck))
        self._answer(MISSION_SERVICE, no_items)
        self._answer(COMMAND, self._command)
        bus.serve_clock()
        bus.serve_stop(self._pressed, lambda request: request.reply(make(CommandAck)))
        bus.announce()

    def _answer(self, service: Service, answer: Any) -> None:
        def handle(request: ServiceRequest) -> None:
            request.reply(answer(request.message))

        self.bus.serve(service, handle)

    def _command(self, _request: Message | None) -> Message:
        """Drive on, whatever the command is."""
        self.vehicle = Vehicle.ACTIVE
        return make(CommandAck)

    def _pressed(self, _operator: str, payload: bytes) -> None:
        """Stop, and let the next status show it; called in the bus's thread."""
        try:
            request = decode(payload).message
        except RemoteError:
            return
        if isinstance(request, CommandRequest):
            self._stop_id = request.request_id
        self.vehicle = Vehicle.EMERGENCY_STOP


def no_items(request: Message | None) -> Message:
    """Return the answer of a robot without a mission and a fence."""
    if not isinstance(request, MissionRequestList):
        return refusal(reasons.NO_MISSION)
    return make(MissionCount, count=0, mission_type=request.mission_type)


@contextmanager
def played_fleet(robots: int, endpoint: str) -> Iterator[list[PlayedRobot]]:
    """Play r1 and so on, and their plant, at an endpoint until the block ends."""
    network, over = Network(mode="router", listen=(endpoint,)), Event()
    dialling = Network(mode="client", connect=(endpoint,))
    with open_bus(network, Role.ROBOT, "r1") as bus, open_bus(dialling, Role.PLANT, "r1") as plant:
        for number in range(robots):
            beside = plant.beside(f"r{number + 1}")
            beside.serve(WORLD, lambda request: request.reply(HALL))
            beside.announce()
        played = [PlayedRobot(bus.beside(f"r{one + 1}"), one) for one in range(robots)]
        thread = Thread(target=play, args=(played, over), daemon=True)
        thread.start()
        try:
            yield played
        finally:
            over.set()
            thread.join()


def play(robots: list[PlayedRobot], over: Event) -> None:
    """Tick each robot at its own place in the period."""
    began_ns, turn = monotonic_ns(), 0
    while not over.is_set():
        for place, robot in enumerate(robots):
            due_ns = began_ns + turn * PERIOD_NS + place * PERIOD_NS // len(robots)
            late_s = (due_ns - monotonic_ns()) / NS_PER_S
            if late_s > 0.001 and over.wait(late_s):
                return
            if turn % 10 == place % 10:
                robot.look()
            robot.tick()
        turn += 1
