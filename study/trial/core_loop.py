"""The sensor samples of a control core, and its goal, as the robot process handles them."""

from typing import Final

from protocol.topics import SONAR, WHEELS
from protocol.wire.enums import Command
from protocol.wire.goal import WireGoal
from protocol.wire.messages import CommandRequest, SonarScan, WheelTicks
from robot.core import reasons, states
from robot.core.brain import ignore
from robot.core.parameters import Params
from robot.core.perception.from_messages import goal_of, now_ms_of, scan_of, wheels_of
from robot.core.values import Inputs, Outputs, Wheels
from robot.hosting.core import Core
from runtime.units import NS_PER_MS

WHEELS_STALE_MS = WHEELS.stale_after_ns // NS_PER_MS
SCAN_STALE_MS = SONAR.stale_after_ns // NS_PER_MS
ARM: Final = CommandRequest(
    request_id=0, param1=1.0, param2=0.0, command=Command.COMPONENT_ARM_DISARM
)


class CoreLoop:
    """Hold the latest sensor samples for a core.

    A sample that is not renewed becomes stale after its topic's time and is then passed as None.
    """

    __slots__ = ("_scan", "_scan_ms", "_wheels", "_wheels_ms", "core", "now_ms", "state")

    def __init__(self, core: Core) -> None:
        self.core = core
        self.state = core.state
        self.now_ms = 0
        self._wheels: Wheels | None = None
        self._scan: SonarScan | None = None
        self._wheels_ms = self._scan_ms = 0

    @property
    def params(self) -> Params:
        """The parameters in force."""
        return self.core.params

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
        return self.core.step(inputs, ignore)

    def go(self, goal: WireGoal) -> int:
        """Arm and drive to the goal without an operator; return the reason of a refusal, or 0."""
        refusal = self.core.command(ARM, self.now_ms)
        if refusal != reasons.OK:
            return refusal
        return self.core.drive_to(goal_of(*goal), states.AUTO, self.now_ms)
