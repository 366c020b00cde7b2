"""Tables of topics and services (key, messages, rate, publisher, priority), and of MAVLink ids."""

from typing import Any, Final, NamedTuple, TypeVar

from protocol.topic import DIALECT as DIALECT
from protocol.topic import ENCODING as ENCODING
from protocol.topic import ENCODING_FAMILY as ENCODING_FAMILY
from protocol.topic import PREFIX as PREFIX
from protocol.topic import Priority as Priority
from protocol.topic import Role as Role
from protocol.topic import Service as Service
from protocol.topic import Topic as Topic
from protocol.topic import operator_in as operator_in
from protocol.topic import robot_name as robot_name
from protocol.topic import robot_names as robot_names
from protocol.wire.limits import (
    MAX_TELEOP_TTL_MS,
    MAX_WHEEL_TTL_MS,
    OPERATOR_LOST_MS,
    SCAN_LOST_MS,
    TICKS_LOST_MS,
)
from protocol.wire.message import Message
from protocol.wire.messages import (
    AvoidanceDecision,
    CommandAck,
    CommandRequest,
    CycleReport,
    GatewayStatus,
    GoalRequest,
    GroundTruth,
    Heartbeat,
    LeaseRequest,
    LeaseStatus,
    McuStatus,
    MissionClearAll,
    MissionCount,
    MissionItemInt,
    MissionRequestInt,
    MissionRequestList,
    MissionStatus,
    MissionVerdict,
    NavigatorStatus,
    ParamRequestRead,
    ParamSet,
    ParamValue,
    PlanarOdometry,
    RobotMotion,
    RunRequest,
    SonarScan,
    Statustext,
    SystemTime,
    Teleop,
    TickInputs,
    Timesync,
    WheelCommand,
    WheelTicks,
)
from runtime.units import NS_PER_MS

M = TypeVar("M", bound=Message)

SUMMARY_HZ: Final = 2.0
STOP_REPEAT_MS: Final = 50
"""Period at which an emergency stop is repeated until the status shows that it was executed."""

SONAR: Final = Topic(
    path="sense/sonar",
    messages=(SonarScan,),
    publisher=Role.PLANT,
    rate_hz=20.0,
    stale_after_ns=SCAN_LOST_MS * NS_PER_MS,
    priority=Priority.DATA_HIGH,
    doc="one period of the sonar ring",
)
WHEELS: Final = Topic(
    path="sense/wheels",
    messages=(WheelTicks,),
    publisher=Role.PLANT,
    rate_hz=20.0,
    stale_after_ns=TICKS_LOST_MS * NS_PER_MS,
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
    doc="simulated time, in lockstep only: sent after all sensor data of a tick",
)
TRUTH: Final = Topic(
    path="truth/pose",
    messages=(GroundTruth,),
    publisher=Role.PLANT,
    rate_hz=20.0,
    stale_after_ns=250 * NS_PER_MS,
    priority=Priority.DATA_LOW,
    doc="true pose of the robot; for evaluation only",
)
MOTION: Final = Topic(
    path="truth/motion",
    messages=(RobotMotion,),
    publisher=Role.PLANT,
    rate_hz=20.0,
    stale_after_ns=250 * NS_PER_MS,
    priority=Priority.DATA_HIGH,
    doc="motion of the robot in the next period, for the other plants of its world",
)
DRIVE: Final = Topic(
    path="drive/wheels",
    messages=(WheelCommand,),
    publisher=Role.ROBOT,
    rate_hz=20.0,
    stale_after_ns=MAX_WHEEL_TTL_MS * NS_PER_MS,
    priority=Priority.REAL_TIME,
    doc="wheel speeds with their time-to-live",
)
HEARTBEAT: Final = Topic(
    path="tlm/heartbeat",
    messages=(Heartbeat,),
    publisher=Role.ROBOT,
    rate_hz=5.0,
    stale_after_ns=1000 * NS_PER_MS,
    doc="health of the control loop, sent from inside it",
)
ODOMETRY: Final = Topic(
    path="tlm/odometry",
    messages=(PlanarOdometry,),
    publisher=Role.ROBOT,
    rate_hz=20.0,
    stale_after_ns=250 * NS_PER_MS,
    doc="estimated pose of the robot, with covariance",
)
STATUS: Final = Topic(
    path="tlm/status",
    messages=(NavigatorStatus,),
    publisher=Role.ROBOT,
    rate_hz=20.0,
    stale_after_ns=250 * NS_PER_MS,
    doc="vehicle, mode, goal and navigator",
)
DECISION: Final = Topic(
    path="tlm/decision",
    messages=(AvoidanceDecision,),
    publisher=Role.ROBOT,
    rate_hz=20.0,
    stale_after_ns=250 * NS_PER_MS,
    priority=Priority.DATA_LOW,
    doc="inputs and decision of the navigator",
)
CYCLE: Final = Topic(
    path="tlm/cycle",
    messages=(CycleReport,),
    publisher=Role.ROBOT,
    rate_hz=20.0,
    stale_after_ns=250 * NS_PER_MS,
    priority=Priority.DATA_LOW,
    doc="cost and lateness of each control cycle",
)
MCU: Final = Topic(
    path="tlm/mcu",
    messages=(McuStatus,),
    publisher=Role.ROBOT,
    rate_hz=20.0,
    stale_after_ns=250 * NS_PER_MS,
    priority=Priority.DATA_LOW,
    doc="cost and memory of the board that runs the control core, if there is one",
)
TEXT: Final = Topic(
    path="tlm/text",
    messages=(Statustext,),
    publisher=Role.ROBOT,
    rate_hz=0.0,
    stale_after_ns=0,
    history=128,
    doc="texts about events, for operators",
)
LEASE: Final = Topic(
    path="tlm/lease",
    messages=(LeaseStatus,),
    publisher=Role.ROBOT,
    rate_hz=2.0,
    stale_after_ns=1500 * NS_PER_MS,
    doc="operator that commands the robot; sent at once when it changes",
)
MISSION: Final = Topic(
    path="tlm/mission",
    messages=(MissionStatus,),
    publisher=Role.ROBOT,
    rate_hz=2.0,
    stale_after_ns=1500 * NS_PER_MS,
    doc="progress of the mission; sent at once when it changes",
)
INPUTS: Final = Topic(
    path="tlm/inputs",
    messages=(TickInputs,),
    publisher=Role.ROBOT,
    rate_hz=20.0,
    stale_after_ns=250 * NS_PER_MS,
    priority=Priority.DATA_LOW,
    doc="inputs of the control core, for the re-execution of a recorded run",
)


def summary_of(topic: Topic[M], rate_hz: float, when: str = "") -> Topic[M]:
    """Return the topic that has the newest message of a stream twice a second."""
    return Topic(
        path=f"summary/{topic.path.partition('/')[2]}",
        messages=topic.messages,
        publisher=topic.publisher,
        rate_hz=rate_hz,
        stale_after_ns=1500 * NS_PER_MS,
        doc=f"{topic.path} for stations that watch many robots{when}: each half second of wall "
        "time, and at once when mode, vehicle, goal or emergency stop change",
    )


SUMMARIES: Final[dict[str, Topic[Any]]] = {
    STATUS.path: summary_of(STATUS, SUMMARY_HZ),
    ODOMETRY.path: summary_of(ODOMETRY, SUMMARY_HZ),
    INPUTS.path: summary_of(INPUTS, 0.0, ", while wheel ticks or scans are missing"),
}
"""The summaries of a robot, by the paths of the streams that they are taken from."""

COMMANDED: Final[Topic[Message]] = Topic(
    path="tlm/commanded",
    messages=(
        CommandRequest,
        GoalRequest,
        ParamSet,
        LeaseRequest,
        MissionCount,
        MissionItemInt,
        MissionClearAll,
    ),
    publisher=Role.ROBOT,
    rate_hz=0.0,
    stale_after_ns=0,
    history=512,
    doc="copies of the requests to the robot, for recordings",
)
ANSWERED: Final[Topic[Message]] = Topic(
    path="tlm/answered",
    messages=(CommandAck, ParamValue, MissionRequestInt, MissionVerdict),
    publisher=Role.ROBOT,
    rate_hz=0.0,
    stale_after_ns=0,
    history=512,
    doc="copies of the robot's answers, for recordings",
)
OPERATOR: Final = Topic(
    path="op/heartbeat",
    messages=(Heartbeat,),
    publisher=Role.GROUND,
    rate_hz=5.0,
    stale_after_ns=OPERATOR_LOST_MS * NS_PER_MS,
    doc="heartbeat of an operator",
)
TELEOP: Final = Topic(
    path="op/teleop",
    messages=(Teleop,),
    publisher=Role.GROUND,
    rate_hz=10.0,
    stale_after_ns=MAX_TELEOP_TTL_MS * NS_PER_MS,
    priority=Priority.DATA_HIGH,
    doc="speeds for driving in MANUAL, each with its own time-to-live",
)
STOP: Final = Topic(
    path="op/stop",
    messages=(CommandRequest,),
    publisher=Role.GROUND,
    rate_hz=0.0,
    stale_after_ns=0,
    priority=Priority.REAL_TIME,
    doc="emergency stop: any sample stops the robot, even a malformed one; repeated every "
    f"{STOP_REPEAT_MS} ms until the status shows EMERGENCY_STOP with its request_id as stop_id",
)
MARK: Final = Topic(
    path="op/mark",
    messages=(Statustext,),
    publisher=Role.GROUND,
    rate_hz=0.0,
    stale_after_ns=0,
    history=128,
    doc="an operator's remark, for recordings",
)

GATEWAY: Final = Topic(
    path="op/gateway",
    messages=(GatewayStatus,),
    publisher=Role.GROUND,
    rate_hz=1.0,
    stale_after_ns=3000 * NS_PER_MS,
    priority=Priority.DATA_LOW,
    doc="state of a MAVLink gateway and its clients",
)

COMMAND: Final = Service(
    path="srv/command",
    requests=(CommandRequest, GoalRequest),
    server=Role.ROBOT,
    doc="command or goal -> CommandAck, whose result_param2 is a Reason. Commands that use param1: "
    "COMPONENT_ARM_DISARM 1 arm, 0 disarm; DO_PAUSE_CONTINUE 0 hold, 1 resume; MISSION_START first "
    "item, -1: the current one; DO_SET_MISSION_CURRENT item. DO_SET_MODE uses param2. "
    "DO_CHANGE_SPEED limits the drive to param2 m/s, -2 ends that; with param1 1 only the goal",
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
    "saved (whether it survives a restart)",
)
STOP_SERVICE: Final = Service(
    path="srv/stop",
    requests=(CommandRequest,),
    server=Role.ROBOT,
    priority=Priority.REAL_TIME,
    expires=False,
    doc="emergency stop, as on op/stop -> CommandAck once the robot is in EMERGENCY_STOP",
)
CLOCK_SERVICE: Final = Service(
    path="srv/clock",
    requests=(Timesync,),
    server=Role.ROBOT,
    expires=False,
    doc="the operator's time (ts1) -> the robot's clock (tc1), used for deadlines and ages",
)
LEASE_SERVICE: Final = Service(
    path="srv/lease",
    requests=(LeaseRequest,),
    server=Role.ROBOT,
    doc="take, release or seize the lease -> CommandAck, whose result_param2 is a Reason",
)
MISSION_SERVICE: Final = Service(
    path="srv/mission",
    requests=(
        MissionCount,
        MissionItemInt,
        MissionRequestList,
        MissionRequestInt,
        MissionClearAll,
    ),
    server=Role.ROBOT,
    doc="a transfer of items, one frame at a time. Upload: MissionCount -> MissionRequestInt(0), "
    "MissionItemInt(k) -> MissionRequestInt(k + 1), the last -> MissionVerdict. Download: "
    "MissionRequestList -> MissionCount, MissionRequestInt(k) -> MissionItemInt. MissionClearAll "
    "-> MissionVerdict. At any point a MissionVerdict with a reason refuses the transfer",
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
    MOTION,
    DRIVE,
    HEARTBEAT,
    ODOMETRY,
    STATUS,
    DECISION,
    CYCLE,
    MCU,
    TEXT,
    LEASE,
    MISSION,
    INPUTS,
    *SUMMARIES.values(),
    COMMANDED,
    ANSWERED,
    OPERATOR,
    TELEOP,
    STOP,
    MARK,
    GATEWAY,
)
SERVICES: Final = (
    COMMAND,
    STOP_SERVICE,
    PARAMETER,
    PARAMETERS,
    LEASE_SERVICE,
    MISSION_SERVICE,
    CLOCK_SERVICE,
    RUN,
    WORLD,
)
PATHS: Final = frozenset(topic.path for topic in TOPICS) | frozenset(
    service.path for service in SERVICES
)


class KeyParts(NamedTuple):
    """Robot, path and operator of a key; `operator` is empty if the key has none."""

    robot: str
    path: str
    operator: str = ""


def key_parts(key: str) -> KeyParts | None:
    """Parse the key of a topic or service, under any prefix; return None for any other key."""
    chunks = key.split("/")
    for place in range(len(chunks) - 2):
        path = f"{chunks[place + 1]}/{chunks[place + 2]}"
        if path in PATHS:
            return KeyParts(chunks[place], path, operator_in("/".join(chunks[place + 3 :])))
    return None


def path_of(key: str) -> str:
    """Return the path of the topic or service that a key belongs to; empty for any other key."""
    parts = key_parts(key)
    return "" if parts is None else parts.path


COMPONENT: Final = {Role.ROBOT: 1, Role.PLANT: 25, Role.DRIVER: 25, Role.GROUND: 190}
OPERATOR_SYSTEM: Final = 255
NO_ROLE: Final = (254, 0)
MAX_ROBOT_SYSTEM: Final = 250


def system_id_of(robot: str) -> int:
    """Return the number at the end of a robot's name, as in r7; 1 if there is none."""
    digits = robot[len(robot.rstrip("0123456789")) :]
    number = int(digits or 1)
    return number if 1 <= number <= MAX_ROBOT_SYSTEM else 1


def sender_of(role: Role | None, robot: str) -> tuple[int, int]:
    """Return system and component id of a sender; plant and robot are components of one system."""
    if role is None:
        return NO_ROLE
    return (OPERATOR_SYSTEM if role is Role.GROUND else system_id_of(robot)), COMPONENT[role]
