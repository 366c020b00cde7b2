"""The control core as the robot process runs it, without the process."""

from protocol.topics import SONAR, WHEELS
from protocol.wire.goal import WireGoal
from protocol.wire.messages import SonarScan, WheelTicks
from robot.core import brain, modes, reasons, states
from robot.core.parameters import Params
from robot.core.perception.from_messages import goal_of, now_ms_of, scan_of, wheels_of
from robot.core.values import Inputs, Outputs, Pose, Wheels
from runtime.units import NS_PER_MS

WHEELS_STALE_MS = WHEELS.stale_after_ns // NS_PER_MS
SCAN_STALE_MS = SONAR.stale_after_ns // NS_PER_MS


class CoreLoop:
    """Hold the latest sensor samples and the state of the core.

    A sample that is not renewed becomes stale after its topic's time and is then passed as None.
    """

    __slots__ = ("_scan", "_scan_ms", "_wheels", "_wheels_ms", "now_ms", "params", "state")

    def __init__(self, params: Params, start: Pose, totals: tuple[int, int] = (0, 0)) -> None:
        """Create the core; `start` is the pose that the robot is given, in the world frame.

        `totals` are the encoder counters at that pose.
        """
        self.params = params
        self.state = brain.State(params)
        odometry = self.state.odometry
        odometry.pose = start
        odometry.left, odometry.right = totals
        self.now_ms = 0
        self._wheels: Wheels | None = None
        self._scan: SonarScan | None = None
        self._wheels_ms = self._scan_ms = 0

    def step(self, now_ns: int, wheels: WheelTicks | None, scan: SonarScan | None) -> Outputs:
        """Run one tick with the samples that arrived for it, None where none arrived."""
        self.now_ms = now_ms = now_ms_of(now_ns)
        if wheels is not None:
            self._wheels, self._wheels_ms = wheels_of(wheels), now_ms
        elif now_ms - self._wheels_ms > WHEELS_STALE_MS:
            self._wheels = None
        if scan is not None:
            self._scan, self._scan_ms = scan, now_ms
        elif now_ms - self._scan_ms > SCAN_STALE_MS:
            self._scan = None
        seen = None if self._scan is None else scan_of(self._scan, now_ms - self._scan_ms)
        inputs = Inputs(now_ms, self._wheels, seen, None)
        self.state, outputs = brain.step(self.state, inputs, self.params)
        return outputs

    def go(self, goal: WireGoal) -> int:
        """Arm and drive to the goal without an operator; return the reason of a refusal, or 0."""
        machine = self.state.machine
        refusal = modes.arm(machine)
        if refusal != reasons.OK:
            return refusal
        return modes.goto(machine, goal_of(*goal), states.AUTO, self.now_ms)
