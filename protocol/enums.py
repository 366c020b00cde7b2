"""The enumerations of the dialect, written out so that a type checker sees their members."""

from enum import IntEnum


class Vehicle(IntEnum):
    BOOT = 0
    STANDBY = 1
    ACTIVE = 2
    FAILSAFE = 3
    EMERGENCY_STOP = 4


class Mode(IntEnum):
    """The numbers of ArduPilot Rover."""

    MANUAL = 0
    HOLD = 4
    AUTO = 10
    SMART_RTL = 12
    GUIDED = 15


class GoalState(IntEnum):
    NONE = 0
    ACCEPTED = 1
    DRIVING = 2
    AVOIDING = 3
    ALIGNING = 4
    REACHED = 5
    STUCK = 6
    ABORTED = 7
    REFUSED = 8


class Navigator(IntEnum):
    BUG = 1
    VGM = 2
    BUG1 = 3
    BUG2 = 4
    DISTBUG = 5
    VGM_MEMORY = 6


class Branch(IntEnum):
    NONE = 0
    TO_GOAL = 1
    PASS_LEFT = 2
    PASS_RIGHT = 3
    ALIGN = 4
    GIVE_UP = 5


class RunAction(IntEnum):
    SCORE = 0
    START = 1
    PAUSE = 2


class LeaseAction(IntEnum):
    TAKE = 0
    RELEASE = 1
    SEIZE = 2


class MissionState(IntEnum):
    NONE = 0
    READY = 1
    RUNNING = 2
    HOLDING = 3
    PAUSED = 4
    DONE = 5
    FAILED = 6


class MissionType(IntEnum):
    """MAV_MISSION_TYPE: what a transfer of items is about."""

    MISSION = 0
    FENCE = 1


class Command(IntEnum):
    """The MAV_CMD numbers in use."""

    NAV_WAYPOINT = 16
    NAV_RETURN_TO_LAUNCH = 20
    DO_SET_MODE = 176
    DO_FLIGHTTERMINATION = 185
    DO_REPOSITION = 192
    DO_PAUSE_CONTINUE = 193
    DO_SET_MISSION_CURRENT = 224
    MISSION_START = 300
    COMPONENT_ARM_DISARM = 400
    NAV_FENCE_POLYGON_VERTEX_INCLUSION = 5001
    NAV_FENCE_CIRCLE_INCLUSION = 5003
    SIDESTEP_SET_NAVIGATOR = 54100
    SIDESTEP_ABORT_GOAL = 54101
    SIDESTEP_CLEAR_EMERGENCY_STOP = 54102
    SIDESTEP_NAV_POSE = 54103


class AckResult(IntEnum):
    """MAV_RESULT: how COMMAND_ACK answers."""

    ACCEPTED = 0
    TEMPORARILY_REJECTED = 1
    DENIED = 2
    UNSUPPORTED = 3
    FAILED = 4
    IN_PROGRESS = 5


class Severity(IntEnum):
    """MAV_SEVERITY of a STATUSTEXT."""

    EMERGENCY = 0
    ALERT = 1
    CRITICAL = 2
    ERROR = 3
    WARNING = 4
    NOTICE = 5
    INFO = 6
    DEBUG = 7


class SystemState(IntEnum):
    """MAV_STATE of a HEARTBEAT."""

    UNINIT = 0
    BOOT = 1
    CALIBRATING = 2
    STANDBY = 3
    ACTIVE = 4
    CRITICAL = 5
    EMERGENCY = 6
    POWEROFF = 7
    FLIGHT_TERMINATION = 8


TYPE_GCS = 6
TYPE_GROUND_ROVER = 10
AUTOPILOT_GENERIC = 0
AUTOPILOT_INVALID = 8
MODE_FLAG_CUSTOM_MODE_ENABLED = 1
MODE_FLAG_SAFETY_ARMED = 128
FRAME_LOCAL_FLU = 21
PARAM_TYPE_INT32 = 6
PARAM_TYPE_REAL32 = 9
