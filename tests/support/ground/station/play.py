"""A robot, a plant and a station on a played bus; the test owns time."""

import json
from collections.abc import Callable
from functools import partial
from typing import Self

from ground.station.robot.background_requests import Job, JobResult, outcome_of
from ground.station.station import Station
from ground.station.world import WorldFacts
from protocol.bus.network import Hub
from protocol.topic import person_of
from protocol.topics import (
    COMMAND,
    LEASE_SERVICE,
    OPERATOR,
    PARAMETER,
    PARAMETERS,
    STATUS,
    STOP,
    TEXT,
    WORLD,
    Role,
)
from protocol.wire.codec import Encoder
from protocol.wire.enums import AckResult, LeaseAction, Vehicle
from protocol.wire.message import Message
from protocol.wire.messages import (
    CommandAck,
    CommandRequest,
    LeaseRequest,
    ParamValue,
    Statustext,
)
from protocol.wire.reasons import Reason
from protocol.wire.statustext import pieces_of
from robot.commands import acknowledge
from runtime.clock import ManualClock
from runtime.errors import NoAnswerError
from runtime.units import PERIOD_NS
from tests.support.ground.station.said import Robot
from tests.support.played_bus import PlayedBus

S = 1_000_000_000
PARAMS = {"d_obs_m": 0.3, "side": 1, "op_lost_ms": 1500, "accel_m_s2": 1.25, "v_max_m_s": 0.25}
WORLD_TEXT = b"""{"name": "box", "size_m": [6.0, 4.0], "walls": true,
 "start": {"x_m": 0.6, "y_m": 2.0, "heading_deg": 90.0},
 "goal": {"x_m": 5.4, "y_m": 2.0, "heading_deg": null, "position_tolerance_m": 0.05},
 "obstacles": [{"polygon_m": [[2, 1], [3, 1], [3, 2]]},
  {"wall_m": [[0, 3], [2, 3]], "thickness_m": 0.02},
  {"circle_m": {"x": 4, "y": 3, "radius": 0.25}},
  {"circle_m": {"x": 1, "y": 1, "radius": 0.1}, "path_m": [[1, 1], [1, 3]], "speed_m_s": 0.5}],
 "robot": {"radius_m": 0.15}}"""


class Inline:
    """A lane without a thread: the job runs at once, or when the test calls `work`."""

    def __init__(self, *, waits: bool = False) -> None:
        self.busy = False
        self.waits = waits
        self._job: Job | None = None
        self._outcome: JobResult | None = None

    def start(self, job: Job) -> bool:
        if self.busy:
            return False
        self.busy, self._job = True, job
        if not self.waits:
            self.work()
        return True

    def work(self) -> None:
        if self._job is not None:
            self._outcome, self._job = outcome_of(self._job), None

    def done(self) -> JobResult | None:
        outcome, self._outcome = self._outcome, None
        if outcome is not None:
            self.busy = False
        return outcome

    def close(self, deadline_s: float) -> None:
        self.busy = False


class Play:
    """`forward` lets time go by in periods of 50 ms; the station is polled in each."""

    def __init__(
        self, world: WorldFacts | None = None, workers: Callable[[str], Inline] | None = None
    ) -> None:
        self.clock = ManualClock(1000 * S)
        self.bus = PlayedBus(self.clock)
        self.robots = [Robot()]
        self.delivered = True
        self.workers: dict[str, Inline] = {}
        self.commands: list[CommandRequest] = []
        self.refuses = Reason.NONE
        self.params: dict[str, float] = dict(PARAMS)
        self.bus.come(Role.ROBOT)
        self.bus.come(Role.PLANT)
        for name in ("r1", "r2"):
            self.bus.publisher(STOP, name).heard = partial(self._press, name)
        self._worker = workers or (lambda _name: Inline())
        self._serve()
        self.station = Station(
            self.bus, "r1", self.clock, world, name="anna", workers=self._make_lane
        )

    @property
    def robot(self) -> Robot:
        return self.robots[0]

    @property
    def beats(self) -> int:
        """Return the number of heartbeats that the station sent for r1."""
        return len(self.bus.publisher(OPERATOR, "r1").said)

    def forward(self, seconds: float, *, poll: bool = True) -> Self:
        for _ in range(round(seconds * 20)):
            for robot in self.robots:
                for topic, message in robot.said():
                    (self.bus.say if self.delivered else self.bus.lose)(topic, message, robot.name)
            if poll:
                self.station.poll()
            self.clock.advance(PERIOD_NS)
        return self

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
        self.bus.say_frame(TEXT, frame, age_ns=age_ns)

    def _press(self, name: str, request: Message) -> None:
        """Deliver an emergency stop if the robot can be reached and its loop runs."""
        if not (self.robot.loop and self.delivered):
            return
        assert isinstance(request, CommandRequest)
        self.commands.append(request)
        self.robot.vehicle, self.robot.stop_id = Vehicle.EMERGENCY_STOP, request.request_id
        self.bus.say(STATUS, self.robot.status(), name)

    # The robot's services.

    def _make_lane(self, name: str) -> Inline:
        return self.workers.setdefault(name, self._worker(name))

    def _serve(self) -> None:
        self.bus.answers |= {
            PARAMETERS.path: lambda _: listed(self.params),
            PARAMETER.path: lambda _: ParamValue(
                param_id="radius_m", param_value=0.12, param_type=9, param_count=2, param_index=0
            ),
            WORLD.path: lambda _: WORLD_TEXT,
            LEASE_SERVICE.path: self._lease,
            COMMAND.path: self._command,
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


def refused(reason: Reason) -> CommandAck:
    return CommandAck(command=0, result=AckResult.DENIED, result_param2=reason)


def silent(_: Message | None) -> Message:
    """Provide a service that never answers."""
    raise NoAnswerError("no answer within 0.25 s")
