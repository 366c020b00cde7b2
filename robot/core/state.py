"""The complete state of the core between two ticks."""

from math import inf

from robot.core import reasons
from robot.core.modes import Machine
from robot.core.motion import ProgressMonitor, Trail
from robot.core.navigators import registry
from robot.core.parameters import Params
from robot.core.perception.odometry import Odometry
from robot.core.perception.slip import Slip
from robot.core.perception.sonar_ring import FrozenSonar, Ring
from robot.core.perception.stall import Stall
from robot.core.perception.wall_heading import WallHeading
from robot.core.values import Decision, Twist


class State:
    """The state of the core; `goal_distance_m` and `decision` are outputs for the host.

    `reported` is a failsafe reason that only the host can detect, such as BUDGET. `pursuits`
    follows the counter of the machine. `arrived` is set at the goal's place. `twist` is the last
    commanded twist. `crowded` counts ticks with a near echo at the goal. `manual` is the operator's
    twist in MANUAL, set by the host for each tick, or None.
    """

    __slots__ = (
        "arrived",
        "bumped",
        "bumper",
        "crowded",
        "decision",
        "driving",
        "frozen",
        "goal_distance_m",
        "machine",
        "manual",
        "memory",
        "odometry",
        "progress",
        "pursuits",
        "reported",
        "ring",
        "slip",
        "stall",
        "trail",
        "twist",
        "walls",
    )

    def __init__(self, params: Params) -> None:
        self.machine = Machine(params)
        self.odometry = Odometry()
        self.ring = Ring()
        self.frozen = FrozenSonar()
        self.memory = registry.new_memory(params.navigator, params.side, self.odometry)
        self.trail = Trail()
        self.progress = ProgressMonitor()
        self.slip = Slip()
        self.stall = Stall()
        self.walls = WallHeading()
        self.twist = Twist(0.0, 0.0)
        self.manual: Twist | None = None
        self.decision: Decision | None = None
        self.goal_distance_m = inf
        self.pursuits = 0
        self.arrived = self.driving = False
        self.bumper = self.crowded = 0
        self.bumped = False
        self.reported: int = reasons.OK
