"""Why: the number that comes with every refusal, stop and outcome; the dialect holds the words."""

from robot.core.typed import Final

OK: Final = 0

NOT_ARMED: Final = 1
NO_SENSES: Final = 2
EMERGENCY_STOPPED: Final = 3
GOAL_OUT_OF_RANGE: Final = 4
TOLERANCE_OUT_OF_RANGE: Final = 5
UNKNOWN_MODE: Final = 6
UNKNOWN_NAVIGATOR: Final = 7
UNKNOWN_COMMAND: Final = 8
UNKNOWN_PARAMETER: Final = 9
PARAMETER_OUT_OF_RANGE: Final = 10
NO_GOAL: Final = 11
NO_TRAIL: Final = 12
NO_OPERATOR: Final = 13
BUSY_DRIVING: Final = 14
NOT_SAVED: Final = 15
MALFORMED: Final = 16
LEASE_HELD: Final = 17
OUTSIDE_FENCE: Final = 18
NO_MISSION: Final = 19
MISSION_EMPTY: Final = 20
MISSION_ITEM_BAD: Final = 21
MISSION_TOO_LONG: Final = 22
HOLD_OUT_OF_RANGE: Final = 23
UNKNOWN_FRAME: Final = 24
FENCE_NOT_SIMPLE: Final = 25
FENCE_LEAVES_ROBOT_OUT: Final = 26

TICKS_LOST: Final = 30
SCAN_LOST: Final = 31
SONAR_FROZEN: Final = 32
SONAR_IMPOSSIBLE: Final = 33
ENCODER_IMPOSSIBLE: Final = 34
WHEEL_STUCK: Final = 35
NOT_FINITE: Final = 36
BUMPER: Final = 37
OPERATOR_LOST: Final = 38
BUDGET: Final = 39
CORE_EXCEPTION: Final = 40
FENCE_BREACHED: Final = 41

BLOCKED: Final = 60
NO_PROGRESS: Final = 61
UNREACHABLE: Final = 62
BY_OPERATOR: Final = 63
REPLACED: Final = 64
DISARMED: Final = 65
SHUT_DOWN: Final = 66

OBSTACLE_AHEAD: Final = 80
SLOWED: Final = 81
WHEEL_LIMIT: Final = 82
