"""Why: the number that comes with every refusal, stop and outcome, and its words."""

from enum import IntEnum

from protocol.dialect.layouts import REASON_TEXTS


class Reason(IntEnum):
    """SIDESTEP_REASON: refusals 1-29 and 100-119, failsafes 30-59, ends of a goal 60-79,
    guard 80-99.
    """

    NONE = 0
    NOT_ARMED = 1
    NO_SENSES = 2
    EMERGENCY_STOPPED = 3
    GOAL_OUT_OF_RANGE = 4
    TOLERANCE_OUT_OF_RANGE = 5
    UNKNOWN_MODE = 6
    UNKNOWN_NAVIGATOR = 7
    UNKNOWN_COMMAND = 8
    UNKNOWN_PARAMETER = 9
    PARAMETER_OUT_OF_RANGE = 10
    NO_GOAL = 11
    NO_TRAIL = 12
    NO_OPERATOR = 13
    DRIVING = 14
    NOT_SAVED = 15
    MALFORMED = 16
    LEASE_HELD = 17
    OUTSIDE_FENCE = 18
    NO_MISSION = 19
    MISSION_EMPTY = 20
    MISSION_ITEM_BAD = 21
    MISSION_TOO_LONG = 22
    HOLD_OUT_OF_RANGE = 23
    UNKNOWN_FRAME = 24
    FENCE_NOT_SIMPLE = 25
    FENCE_LEAVES_ROBOT_OUT = 26
    TOO_MANY_REQUESTS = 27
    ID_REUSED = 28
    TOO_LATE = 29
    TICKS_LOST = 30
    SCAN_LOST = 31
    SONAR_FROZEN = 32
    SONAR_IMPOSSIBLE = 33
    ENCODER_IMPOSSIBLE = 34
    WHEEL_STUCK = 35
    NOT_FINITE = 36
    BUMPER = 37
    OPERATOR_LOST = 38
    BUDGET = 39
    CORE_EXCEPTION = 40
    FENCE_BREACHED = 41
    NAME_TAKEN = 42
    BLOCKED = 60
    NO_PROGRESS = 61
    UNREACHABLE = 62
    BY_OPERATOR = 63
    REPLACED = 64
    DISARMED = 65
    SHUT_DOWN = 66
    OBSTACLE_AHEAD = 80
    SLOWED = 81
    WHEEL_LIMIT = 82
    FENCE_UNREADABLE = 100
    NOT_WHILE_ARMED = 101
    LESS_SAFE_THAN_CONFIGURED = 102
    NO_IDENTITY = 103


def reason_text(code: int) -> str:
    """The words of the dialect for a reason; an unknown number is shown as a number."""
    return REASON_TEXTS.get(code, f"reason {code}")
