"""The enumerations of the dialect.

Made by `make generate` from sidestep.xml: change that file instead.
"""

from enum import IntEnum
from typing import Final


class Vehicle(IntEnum):
    """State of the vehicle."""

    BOOT = 0  # Starting, no senses yet.
    STANDBY = 1  # Disarmed, wheels stopped.
    ACTIVE = 2  # Armed.
    FAILSAFE = 3  # Stopped by a failsafe; arm again to go on.
    EMERGENCY_STOP = 4  # Stopped by an operator; latched until cleared.


class Mode(IntEnum):
    """Modes, with the numbers of ArduPilot Rover."""

    MANUAL = 0  # Driven by the operator.
    HOLD = 4  # Stands still, keeps its goal.
    AUTO = 10  # Drives to its goal, operator or not.
    SMART_RTL = 12  # Drives back along its own trail.
    GUIDED = 15  # Drives to its goal while an operator is heard.


class GoalState(IntEnum):
    """State of the one goal."""

    NONE = 0  # No goal.
    ACCEPTED = 1  # Accepted, not yet driving.
    DRIVING = 2  # On its way.
    AVOIDING = 3  # Avoiding an obstacle.
    ALIGNING = 4  # At the place, turning to the final heading.
    REACHED = 5  # Reached.
    STUCK = 6  # Given up, see the reason.
    ABORTED = 7  # Ended by an operator or a failsafe, see the reason.
    REFUSED = 8  # Never started, see the reason.


class Navigator(IntEnum):
    """Obstacle avoidance in use."""

    BUG = 1  # Bug algorithm of the paper.
    VGM = 2  # Virtual Goal Method of the paper, signs corrected.
    BUG1 = 3  # Bug1: all the way round, then back to the nearest point.
    BUG2 = 4  # Bug2: along the boundary to the line from start to goal.
    DISTBUG = 5  # DistBug: along the boundary until the free way leads nearer than ever.
    VGM_MEMORY = 6  # Virtual Goal Method with a memory of recent echoes.


class Branch(IntEnum):
    """Branch that the navigator took in this tick."""

    NONE = 0  # Not navigating.
    TO_GOAL = 1  # No obstacle in the avoidance zone: straight to the goal.
    PASS_LEFT = 2  # Obstacle on the right: pass it on the left.
    PASS_RIGHT = 3  # Obstacle on the left: pass it on the right.
    ALIGN = 4  # Turning to the final heading.
    GIVE_UP = 5  # Went all the way round: the goal cannot be reached.


class RunAction(IntEnum):
    """Request to the plant."""

    SCORE = 0  # Score the run up to a stamp.
    START = 1  # Let simulated time go on; a running plant begins a new score.
    PAUSE = 2  # Stop simulated time.


class LeaseAction(IntEnum):
    """Request about the lease, the right of one operator to command the robot."""

    TAKE = 0  # Take it; refused while another holds it.
    RELEASE = 1  # Give it back.
    SEIZE = 2  # Take it from its holder.


class MissionState(IntEnum):
    """State of the mission."""

    NONE = 0  # No mission.
    READY = 1  # Accepted, not started.
    RUNNING = 2  # On the way to the current item.
    HOLDING = 3  # At the current item, waiting out its hold time.
    PAUSED = 4  # Stopped by an operator, can go on.
    DONE = 5  # All items reached.
    FAILED = 6  # Ended early, see the reason; can be started again.


class MissionType(IntEnum):
    """MAV_MISSION_TYPE: content of a transfer of items."""

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
    SIDESTEP_SET_NAVIGATOR = 54100  # Choose the navigator and the side it passes obstacles on.
    SIDESTEP_ABORT_GOAL = 54101  # Drop goal or mission and stand still.
    SIDESTEP_CLEAR_EMERGENCY_STOP = 54102  # Release the latched emergency stop; stays disarmed.
    # Mission item: drive to a pose and wait there. x and y are metres times 10000, frame
    # MAV_FRAME_LOCAL_FLU.
    SIDESTEP_NAV_POSE = 54103


class AckResult(IntEnum):
    """MAV_RESULT of a COMMAND_ACK."""

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


BUMPER_LEFT: Final = 1  # Front left.
BUMPER_RIGHT: Final = 2  # Front right.
BUMPER_REAR: Final = 4  # Rear.
INPUT_WHEELS: Final = 1  # Fresh wheel ticks.
INPUT_SCAN: Final = 2  # A fresh scan.
INPUT_BUDGET: Final = 4  # A violated budget.
INPUT_TELEOP: Final = 8  # A fresh TELEOP.
INPUT_NAME_TAKEN: Final = 16  # Another robot of this name on the bus.
TYPE_GCS: Final = 6
TYPE_GROUND_ROVER: Final = 10
AUTOPILOT_GENERIC: Final = 0
AUTOPILOT_ARDUPILOTMEGA: Final = 3
AUTOPILOT_INVALID: Final = 8
MODE_FLAG_SAFETY_ARMED: Final = 128
MODE_FLAG_CUSTOM_MODE_ENABLED: Final = 1
FRAME_GLOBAL: Final = 0
FRAME_GLOBAL_RELATIVE_ALT: Final = 3
FRAME_LOCAL_ENU: Final = 4
FRAME_GLOBAL_INT: Final = 5
FRAME_GLOBAL_RELATIVE_ALT_INT: Final = 6
FRAME_GLOBAL_TERRAIN_ALT: Final = 10
FRAME_GLOBAL_TERRAIN_ALT_INT: Final = 11
FRAME_LOCAL_FLU: Final = 21
PARAM_TYPE_INT32: Final = 6
PARAM_TYPE_REAL32: Final = 9
