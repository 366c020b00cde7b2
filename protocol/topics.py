"""The one table of topics and services: key, message, rate, stale-after, publisher, priority."""

import re
from dataclasses import dataclass
from enum import Enum
from typing import Final, Generic, TypeVar

from protocol.errors import UserError
from protocol.message import Message
from protocol.messages import (
    AvoidanceDecision,
    CommandAck,
    CommandRequest,
    CycleReport,
    GoalRequest,
    GroundTruth,
    Heartbeat,
    NavigatorStatus,
    ParamRequestRead,
    ParamSet,
    ParamValue,
    PlanarOdometry,
    RunRequest,
    SonarScan,
    Statustext,
    SystemTime,
    WheelCommand,
    WheelTicks,
)

MS: Final = 1_000_000
ROBOT_NAME: Final = re.compile(r"[a-z0-9_-]{1,16}\Z")
PREFIX: Final = "sidestep"
ENCODING_FAMILY: Final = "application/mavlink2"
DIALECT: Final = "sidestep@1"
ENCODING: Final = f"{ENCODING_FAMILY};{DIALECT}"

M_co = TypeVar("M_co", bound=Message, covariant=True)


class Role(Enum):
    PLANT = "plant"
    ROBOT = "robot"
    GROUND = "ground"


class Priority(Enum):
    REAL_TIME = 1
    DATA_HIGH = 4
    DATA = 5
    DATA_LOW = 6


def robot_name(name: str) -> str:
    """The name itself; UserError unless it can be one element of a key."""
    if not ROBOT_NAME.match(name):
        raise UserError(
            f"robot name {name!r}: use 1 to 16 of the characters a-z, 0-9, '_' and '-', as in 'r1'"
        )
    return name


@dataclass(frozen=True, slots=True, kw_only=True)
class Topic(Generic[M_co]):
    """A pub/sub stream. `rate_hz` 0: an event; `stale_after_ns` 0: never stale."""

    path: str
    messages: tuple[type[M_co], ...]
    publisher: Role
    rate_hz: float
    stale_after_ns: int
    priority: Priority = Priority.DATA
    doc: str

    def key(self, robot: str, prefix: str = PREFIX) -> str:
        return f"{prefix}/{robot_name(robot)}/{self.path}"


@dataclass(frozen=True, slots=True, kw_only=True)
class Service:
    """A query that is always answered: one request frame (or none), one reply."""

    path: str
    requests: tuple[type[Message], ...]
    server: Role
    doc: str

    def key(self, robot: str, prefix: str = PREFIX) -> str:
        return f"{prefix}/{robot_name(robot)}/{self.path}"


SONAR: Final = Topic(
    path="sense/sonar",
    messages=(SonarScan,),
    publisher=Role.PLANT,
    rate_hz=20.0,
    stale_after_ns=250 * MS,
    priority=Priority.DATA_HIGH,
    doc="one period of the sonar ring",
)
WHEELS: Final = Topic(
    path="sense/wheels",
    messages=(WheelTicks,),
    publisher=Role.PLANT,
    rate_hz=20.0,
    stale_after_ns=150 * MS,
    priority=Priority.DATA_HIGH,
    doc="encoder counters and bumper, latched at the tick",
)
CLOCK: Final = Topic(
    path="sense/clock",
    messages=(SystemTime,),
    publisher=Role.PLANT,
    rate_hz=20.0,
    stale_after_ns=0,
    priority=Priority.DATA_HIGH,
    doc="simulated time, in lockstep only: all senses of this tick have been sent",
)
TRUTH: Final = Topic(
    path="truth/pose",
    messages=(GroundTruth,),
    publisher=Role.PLANT,
    rate_hz=20.0,
    stale_after_ns=250 * MS,
    priority=Priority.DATA_LOW,
    doc="where the robot truly is; for evaluation only",
)
DRIVE: Final = Topic(
    path="drive/wheels",
    messages=(WheelCommand,),
    publisher=Role.ROBOT,
    rate_hz=20.0,
    stale_after_ns=150 * MS,
    priority=Priority.REAL_TIME,
    doc="wheel speeds with their time-to-live",
)
HEARTBEAT: Final = Topic(
    path="tlm/heartbeat",
    messages=(Heartbeat,),
    publisher=Role.ROBOT,
    rate_hz=5.0,
    stale_after_ns=1000 * MS,
    doc="health of the control loop, sent from inside it",
)
ODOMETRY: Final = Topic(
    path="tlm/odometry",
    messages=(PlanarOdometry,),
    publisher=Role.ROBOT,
    rate_hz=20.0,
    stale_after_ns=250 * MS,
    doc="where the robot believes it is, with covariance",
)
STATUS: Final = Topic(
    path="tlm/status",
    messages=(NavigatorStatus,),
    publisher=Role.ROBOT,
    rate_hz=20.0,
    stale_after_ns=250 * MS,
    doc="vehicle, mode, goal and navigator",
)
DECISION: Final = Topic(
    path="tlm/decision",
    messages=(AvoidanceDecision,),
    publisher=Role.ROBOT,
    rate_hz=20.0,
    stale_after_ns=250 * MS,
    priority=Priority.DATA_LOW,
    doc="what the navigator saw and chose",
)
CYCLE: Final = Topic(
    path="tlm/cycle",
    messages=(CycleReport,),
    publisher=Role.ROBOT,
    rate_hz=20.0,
    stale_after_ns=250 * MS,
    priority=Priority.DATA_LOW,
    doc="cost and lateness of each control cycle",
)
TEXT: Final = Topic(
    path="tlm/text",
    messages=(Statustext,),
    publisher=Role.ROBOT,
    rate_hz=0.0,
    stale_after_ns=0,
    doc="events in words",
)
COMMANDED: Final[Topic[Message]] = Topic(
    path="tlm/commanded",
    messages=(CommandRequest, GoalRequest, ParamSet),
    publisher=Role.ROBOT,
    rate_hz=0.0,
    stale_after_ns=0,
    doc="what was asked of the robot, for the record",
)
ANSWERED: Final[Topic[Message]] = Topic(
    path="tlm/answered",
    messages=(CommandAck, ParamValue),
    publisher=Role.ROBOT,
    rate_hz=0.0,
    stale_after_ns=0,
    doc="what the robot answered, for the record",
)
OPERATOR: Final = Topic(
    path="op/heartbeat",
    messages=(Heartbeat,),
    publisher=Role.GROUND,
    rate_hz=5.0,
    stale_after_ns=1500 * MS,
    doc="an operator is there",
)

COMMAND: Final = Service(
    path="srv/command",
    requests=(CommandRequest, GoalRequest),
    server=Role.ROBOT,
    doc="command or goal -> CommandAck, whose result_param2 is a Reason",
)
PARAMETER: Final = Service(
    path="srv/parameter",
    requests=(ParamSet, ParamRequestRead),
    server=Role.ROBOT,
    doc="set or get -> ParamValue, or CommandAck when refused",
)
PARAMETERS: Final = Service(
    path="srv/parameters",
    requests=(),
    server=Role.ROBOT,
    doc="no payload -> JSON list: name, value, default, unit, minimum, maximum, integer, doc, "
    "saved (it survives a restart)",
)
RUN: Final = Service(
    path="sim/run",
    requests=(RunRequest,),
    server=Role.PLANT,
    doc="start, pause, score -> RunScore or CommandAck",
)
WORLD: Final = Service(
    path="sim/world",
    requests=(),
    server=Role.PLANT,
    doc="no payload -> JSON description of the world in force",
)

TOPICS: Final[tuple[Topic[Message], ...]] = (
    SONAR,
    WHEELS,
    CLOCK,
    TRUTH,
    DRIVE,
    HEARTBEAT,
    ODOMETRY,
    STATUS,
    DECISION,
    CYCLE,
    TEXT,
    COMMANDED,
    ANSWERED,
    OPERATOR,
)
SERVICES: Final = (COMMAND, PARAMETER, PARAMETERS, RUN, WORLD)
