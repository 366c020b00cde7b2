"""Times after which a stream counts as lost.

Made by `make generate` from sidestep.xml: change that file instead.
"""

from robot.core.typing_shim import Final

TICKS_LOST_MS: Final = 150  # no fresh wheel ticks for 150 ms
SCAN_LOST_MS: Final = 250  # no fresh sonar scan for 250 ms
OPERATOR_LOST_MS: Final = 1500  # no operator heartbeat for 1.5 s
