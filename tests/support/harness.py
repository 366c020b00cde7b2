"""The stack in one process, for tests of sequences of events.

with Stack("box") as stack:
    stack.arm()
    stack.goto(5.4, 2.0, 0.0)
    stack.until(stack.reached)
    stack.assert_near(5.4, 2.0, 0.0)
"""

from math import degrees, hypot, radians, remainder

from checks.harness.bus_calls import OPERATOR_BEAT
from checks.harness.in_process import FRAME_S, InProcess, reason_in
from protocol.topics import Topic
from protocol.wire.message import Message

__all__ = ["OPERATOR_BEAT", "Stack", "reason_in"]
STOPPING_S = 0.40
"""From the failsafe to a standing robot: braking from 0.3 m/s and the lag of the motors."""


class Stack(InProcess):
    """A stack that a test drives tick by tick and looks at."""

    def assert_near(
        self, x_m: float, y_m: float, deg: float | None = None, *, within_m: float = 0.08
    ) -> None:
        """Require the true pose, not the estimated one."""
        truth = self.truth
        off_m = hypot(truth.x_m - x_m, truth.y_m - y_m)
        assert off_m <= within_m, f"{off_m:.3f} m away from ({x_m}, {y_m}): {self.describe()}"
        if deg is not None:
            off_deg = abs(degrees(remainder(truth.heading_rad - radians(deg), radians(360))))
            assert off_deg <= 5.0, f"{off_deg:.1f} deg off {deg}: {self.describe()}"

    def rejected_shown(self) -> int:
        """Unreadable frames, as the robot's cycle report counts them."""
        newest = self._report.latest()
        assert newest is not None, "no cycle report has arrived"
        return newest[0].rejected

    def digest(self) -> str:
        """SHA-256 over the true trajectory up to the end of the goal."""
        assert self.plant is not None
        ended_ns = self.vehicle.state.machine.goal_ended_ms * 1_000_000
        return bytes(self.plant.plant.score(ended_ns).digest).hex()

    def send_raw(self, topic: Topic[Message], frame: bytes) -> None:
        """Put bytes on a topic as a stranger would, and wait until the robot's side has them."""
        publisher = self.ground.publisher(topic)
        assert self.ground.await_matched([publisher], FRAME_S) == []
        self._send(publisher.key, lambda: publisher.put_frame(frame), self.robot)
