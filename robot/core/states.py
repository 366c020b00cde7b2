"""Numbers of vehicle, mode, goal, navigator and branch states, of bumpers and sides.

Made by `make generate` from sidestep.xml: change that file instead.
"""

from robot.core.typing_shim import Final

BOOT: Final = 0  # Starting, no senses yet.
STANDBY: Final = 1  # Disarmed, wheels stopped.
ACTIVE: Final = 2  # Armed.
FAILSAFE: Final = 3  # Stopped by a failsafe; arm again to go on.
EMERGENCY_STOP: Final = 4  # Stopped by an operator; latched until cleared.

MANUAL: Final = 0  # Driven by the operator.
HOLD: Final = 4  # Stands still, keeps its goal.
AUTO: Final = 10  # Drives to its goal, operator or not.
SMART_RTL: Final = 12  # Drives back along its own trail.
GUIDED: Final = 15  # Drives to its goal while an operator is heard.

NONE: Final = 0  # No goal.
ACCEPTED: Final = 1  # Accepted, not yet driving.
DRIVING: Final = 2  # On its way.
AVOIDING: Final = 3  # Avoiding an obstacle.
ALIGNING: Final = 4  # At the place, turning to the final heading.
REACHED: Final = 5  # Reached.
STUCK: Final = 6  # Given up, see the reason.
ABORTED: Final = 7  # Ended by an operator or a failsafe, see the reason.
REFUSED: Final = 8  # Never started, see the reason.

BUG: Final = 1  # Bug algorithm of the paper.
VGM: Final = 2  # Virtual Goal Method of the paper, signs corrected.
BUG1: Final = 3  # Bug1: all the way round, then back to the nearest point.
BUG2: Final = 4  # Bug2: along the boundary to the line from start to goal.
DISTBUG: Final = 5  # DistBug: along the boundary until the free way leads nearer than ever.
VGM_MEMORY: Final = 6  # Virtual Goal Method with a memory of recent echoes.

NO_BRANCH: Final = 0  # Not navigating.
TO_GOAL: Final = 1  # No obstacle in the avoidance zone: straight to the goal.
PASS_LEFT: Final = 2  # Obstacle on the right: pass it on the left.
PASS_RIGHT: Final = 3  # Obstacle on the left: pass it on the right.
ALIGN: Final = 4  # Turning to the final heading.
GIVE_UP: Final = 5  # Went all the way round: the goal cannot be reached.

BUMPER_LEFT: Final = 1  # Front left.
BUMPER_RIGHT: Final = 2  # Front right.
BUMPER_REAR: Final = 4  # Rear.

LEFT: Final = 1  # Sides on which an obstacle is passed.
RIGHT: Final = -1
