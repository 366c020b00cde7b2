"""The core as the robot process runs it, without the process: senses in, wheel command out."""

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
    """The last senses and the state of the core. A sense that stays away grows stale, then None."""

    __slots__ = ("_add_scan", "_scan_ms", "_wheels", "_wheels_ms", "now_ms", "params", "state")

    def __init__(self, params: Params, start: Pose) -> None:
        """`start`: where it is told that it stands."""
        self.params = params
        self.state = brain.State(params)
        self.state.odometry.pose = start
        self.now_ms = 0
        self._wheels: Wheels | None = None
        self._add_scan: SonarScan | None = None
        self._wheels_ms = self._scan_ms = 0

    def step(self, now_ns: int, wheels: WheelTicks | None, scan: SonarScan | None) -> Outputs:
        """One tick with what arrived for it."""
        self.now_ms = now_ms = now_ms_of(now_ns)
        if wheels is not None:
            self._wheels, self._wheels_ms = wheels_of(wheels), now_ms
        elif now_ms - self._wheels_ms > WHEELS_STALE_MS:
            self._wheels = None
        if scan is not None:
            self._add_scan, self._scan_ms = scan, now_ms
        elif now_ms - self._scan_ms > SCAN_STALE_MS:
            self._add_scan = None
        seen = None if self._add_scan is None else scan_of(self._add_scan, now_ms - self._scan_ms)
        inputs = Inputs(now_ms, self._wheels, seen, None)
        self.state, outputs = brain.step(self.state, inputs, self.params)
        return outputs

    def go(self, goal: WireGoal) -> int:
        """Arm and drive to the goal without an operator; a reason, 0 when accepted."""
        machine = self.state.machine
        refusal = modes.arm(machine)
        if refusal != reasons.OK:
            return refusal
        return modes.goto(machine, goal_of(*goal), states.AUTO, self.now_ms)
