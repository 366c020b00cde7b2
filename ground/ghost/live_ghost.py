"""Read the present state of a simulated robot from the robot and its plant."""

from typing import Any, Final

from ground.client.goal import Destination
from ground.client.link import LISTEN_NS, Link, UnansweredError
from ground.client.operations.parameters import fetch
from ground.ghost.branch_point import BranchPoint, Facts, driving
from ground.ghost.predicted_path import PredictedPath
from ground.ghost.recorded_ghost import DRIVING, changed, goal_of
from protocol.topics import STATUS, TRUTH, WORLD
from protocol.wire.messages import NavigatorStatus
from runtime.errors import RemoteError, UserError
from runtime.files import value_in
from runtime.units import NS_PER_S

ASK_S: Final = 1.0


class LiveState:
    """State of a running robot, from which a ghost can start."""

    def __init__(self, link: Link) -> None:
        """Wait for the robot's messages; raises UnansweredError when they do not arrive."""
        self._link = link
        with link.subscribed(STATUS, TRUTH) as telemetry:
            link.wait(lambda: all(telemetry.latest(topic) for topic in (STATUS, TRUTH)), LISTEN_NS)
            now_ns = link.clock.now_ns()
            status, self._truth = telemetry.live(STATUS, now_ns), telemetry.live(TRUTH, now_ns)
        if status is None:
            raise UnansweredError(link.diagnosis())
        self.status: NavigatorStatus = status

    def instant(self, world: str | None, goal: Destination | None) -> BranchPoint:
        """Return the start of a ghost; `world` and `goal` replace those of the robot.

        Raises UserError without a simulation, as only a simulation provides the true pose.
        """
        truth = self._truth
        if truth is None:
            raise UserError("there is no simulation, which a ghost needs for the true pose")
        pose, whereto = (truth.x_m, truth.y_m, truth.heading_rad), goal or goal_of(self.status)
        return BranchPoint(world or self.world(), pose, truth.time_ns / NS_PER_S, whereto)

    def world(self) -> Facts:
        """Return the world of the plant; RemoteError when the answer is malformed."""
        answer = self._link.bus.ask(WORLD, timeout_s=ASK_S, robot=self._link.robot)
        try:
            facts: Any = value_in(answer) if isinstance(answer, bytes) else None
        except ValueError:
            facts = None
        if not isinstance(facts, dict):
            raise RemoteError("malformed answer of the plant: not a world")
        return facts

    def parameters(self) -> dict[str, float]:
        """Return the robot's parameters for driving that differ from their defaults."""
        return driving(changed(fetch(self._link)))

    def rest(self) -> PredictedPath:
        """Return an open result, because the robot is still driving."""
        return PredictedPath([], DRIVING, "", None, None)
