"""Numbers of the reasons of every refusal, stop and outcome.

Made by `make generate` from sidestep.xml: change that file instead.
"""

from robot.core.typing_shim import Final

OK: Final = 0  # ok
NOT_ARMED: Final = 1  # not armed: arm first
NO_SENSES: Final = 2  # no fresh wheel ticks and sonar scan yet
EMERGENCY_STOPPED: Final = 3  # emergency stop is latched: clear it first
GOAL_OUT_OF_RANGE: Final = 4  # goal is not finite or farther than the robot accepts
TOLERANCE_OUT_OF_RANGE: Final = 5  # tolerance is out of range
UNKNOWN_MODE: Final = 6  # the robot has no such mode
UNKNOWN_NAVIGATOR: Final = 7  # the robot has no such navigator
UNKNOWN_COMMAND: Final = 8  # the robot does not know this command
UNKNOWN_PARAMETER: Final = 9  # the robot has no such parameter
PARAMETER_OUT_OF_RANGE: Final = 10  # parameter value is not finite or out of its range
NO_GOAL: Final = 11  # there is no goal to act on
NO_TRAIL: Final = 12  # there is no trail to follow back
NO_OPERATOR: Final = 13  # this mode needs an operator's heartbeat and none is heard
DRIVING: Final = 14  # not while driving
NOT_SAVED: Final = 15  # it is in force but could not be saved
MALFORMED: Final = 16  # the frame could not be read
LEASE_HELD: Final = 17  # another operator commands the robot
OUTSIDE_FENCE: Final = 18  # goal is outside of the fence
NO_MISSION: Final = 19  # there is no mission to act on
MISSION_EMPTY: Final = 20  # a mission needs at least one item
MISSION_ITEM_BAD: Final = 21  # no such item, or it is not its turn
MISSION_TOO_LONG: Final = 22  # more items than the robot takes
HOLD_OUT_OF_RANGE: Final = 23  # hold time is not a number or out of range
UNKNOWN_FRAME: Final = 24  # the robot does not know this frame
FENCE_NOT_SIMPLE: Final = 25  # the sides of the fence cross, touch or enclose nothing
FENCE_LEAVES_ROBOT_OUT: Final = 26  # the robot itself stands outside of that fence
TOO_MANY_REQUESTS: Final = 27  # too many requests at once: ask again
ID_REUSED: Final = 28  # this request_id belongs to another request: use a new one
TOO_LATE: Final = 29  # the request arrived after its deadline, or carries none
TICKS_LOST: Final = 30  # no fresh wheel ticks for 150 ms
SCAN_LOST: Final = 31  # no fresh sonar scan for 250 ms
SONAR_FROZEN: Final = 32  # sonar values are frozen
SONAR_IMPOSSIBLE: Final = 33  # sonar values are impossible
ENCODER_IMPOSSIBLE: Final = 34  # encoder jumped farther than a wheel can turn
WHEEL_STUCK: Final = 35  # wheel commanded but not turning
NOT_FINITE: Final = 36  # a value is not a number
BUMPER: Final = 37  # bumper contact
OPERATOR_LOST: Final = 38  # no operator heartbeat for 1.5 s
BUDGET: Final = 39  # control cycle over its budget or more than one period late
CORE_EXCEPTION: Final = 40  # the control core failed
FENCE_BREACHED: Final = 41  # the robot is outside of its fence: lift the fence to drive it back
NAME_TAKEN: Final = 42  # another robot of the same name is on the bus
BLOCKED: Final = 60  # has not moved although it tries to
NO_PROGRESS: Final = 61  # has come no closer for too long
UNREACHABLE: Final = 62  # went all the way round: unreachable
BY_OPERATOR: Final = 63  # by the operator
REPLACED: Final = 64  # replaced by a new goal
DISARMED: Final = 65  # disarmed by the operator
SHUT_DOWN: Final = 66  # the robot process is shutting down
OBSTACLE_AHEAD: Final = 80  # guard: obstacle ahead
SLOWED: Final = 81  # guard: slowed for an obstacle
WHEEL_LIMIT: Final = 82  # guard: wheel speed limit
FENCE_UNREADABLE: Final = 100  # the saved fence cannot be read: clear the fence or upload a new one
NOT_WHILE_ARMED: Final = 101  # a safety parameter changes only while the robot is disarmed
LESS_SAFE_THAN_CONFIGURED: Final = 102  # less safe than the configuration allows
NO_IDENTITY: Final = 103  # the request does not name its operator
