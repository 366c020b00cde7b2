"""Limits that robot, plant and operators have to agree on.

Made by `make generate` from sidestep.xml: change that file instead.
"""

from typing import Final

MAX_PARAMETER_NAME_BYTES: Final = 16
MAX_WHEEL_TTL_MS: Final = 150
MAX_OPERATOR_NAME_BYTES: Final = 16
MAX_LEASE_MS: Final = 3000
MAX_TELEOP_TTL_MS: Final = 500

TICKS_LOST_MS: Final = 150  # no fresh wheel ticks for 150 ms
SCAN_LOST_MS: Final = 250  # no fresh sonar scan for 250 ms
OPERATOR_LOST_MS: Final = 1500  # no operator heartbeat for 1.5 s
