"""Numbers and texts of the reasons of every refusal, stop and outcome.

Made by `make generate` from sidestep.xml: change that file instead.
"""

from enum import IntEnum
from typing import Final


class Reason(IntEnum):
    """Reason of a refusal, stop or outcome.

    Codes 1-29 and 100-119 refusals, 30-59 failsafes, 60-79 ends of a goal, 80-99 guard.
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


REASON_TEXTS: Final[dict[int, str]] = {
    0: "ok",
    1: "not armed: arm first",
    2: "no fresh wheel ticks and sonar scan yet",
    3: "emergency stop is latched: clear it first",
    4: "goal is not finite or farther than the robot accepts",
    5: "tolerance is out of range",
    6: "the robot has no such mode",
    7: "the robot has no such navigator",
    8: "the robot does not know this command",
    9: "the robot has no such parameter",
    10: "parameter value is not finite or out of its range",
    11: "there is no goal to act on",
    12: "there is no trail to follow back",
    13: "this mode needs an operator's heartbeat and none is heard",
    14: "not while driving",
    15: "it is in force but could not be saved",
    16: "the frame could not be read",
    17: "another operator commands the robot",
    18: "goal is outside of the fence",
    19: "there is no mission to act on",
    20: "a mission needs at least one item",
    21: "no such item, or it is not its turn",
    22: "more items than the robot takes",
    23: "hold time is not a number or out of range",
    24: "the robot does not know this frame",
    25: "the sides of the fence cross, touch or enclose nothing",
    26: "the robot itself stands outside of that fence",
    27: "too many requests at once: ask again",
    28: "this request_id belongs to another request: use a new one",
    29: "the request arrived after its deadline, or carries none",
    30: "no fresh wheel ticks for 150 ms",
    31: "no fresh sonar scan for 250 ms",
    32: "sonar values are frozen",
    33: "sonar values are impossible",
    34: "encoder jumped farther than a wheel can turn",
    35: "wheel commanded but not turning",
    36: "a value is not a number",
    37: "bumper contact",
    38: "no operator heartbeat for 1.5 s",
    39: "control cycle over its budget or more than one period late",
    40: "the control core failed",
    41: "the robot is outside of its fence: lift the fence to drive it back",
    42: "another robot of the same name is on the bus",
    60: "has not moved although it tries to",
    61: "has come no closer for too long",
    62: "went all the way round: unreachable",
    63: "by the operator",
    64: "replaced by a new goal",
    65: "disarmed by the operator",
    66: "the robot process is shutting down",
    80: "guard: obstacle ahead",
    81: "guard: slowed for an obstacle",
    82: "guard: wheel speed limit",
    100: "the saved fence cannot be read: clear the fence or upload a new one",
    101: "a safety parameter changes only while the robot is disarmed",
    102: "less safe than the configuration allows",
    103: "the request does not name its operator",
}


def reason_text(code: int) -> str:
    """The words for a reason; an unknown number is shown as a number."""
    return REASON_TEXTS.get(code, f"reason {code}")
