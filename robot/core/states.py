"""Numbers of vehicle, mode, goal, navigator and branch states; the dialect has the same ones."""

from robot.core.typed import Final

BOOT: Final = 0
STANDBY: Final = 1
ACTIVE: Final = 2
FAILSAFE: Final = 3
EMERGENCY_STOP: Final = 4

MANUAL: Final = 0
HOLD: Final = 4
AUTO: Final = 10
SMART_RTL: Final = 12
GUIDED: Final = 15

NONE: Final = 0
ACCEPTED: Final = 1
DRIVING: Final = 2
AVOIDING: Final = 3
ALIGNING: Final = 4
REACHED: Final = 5
STUCK: Final = 6
ABORTED: Final = 7
REFUSED: Final = 8

BUG: Final = 1
VGM: Final = 2
BUG1: Final = 3
BUG2: Final = 4
DISTBUG: Final = 5
VGM_MEMORY: Final = 6

LEFT: Final = 1
RIGHT: Final = -1

NO_BRANCH: Final = 0
TO_GOAL: Final = 1
PASS_LEFT: Final = 2
PASS_RIGHT: Final = 3
ALIGN: Final = 4
GIVE_UP: Final = 5
