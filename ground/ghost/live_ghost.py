"""The present instant of a robot in a simulation, asked of it and of its plant."""

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
from runtime.json_reader import value_in
from runtime.units import NS_PER_S

ASK_S: Final = 1.0


class LiveState:
    """Heard once, then asked for what a ghost needs."""

    def __init__(self, link: Link) -> None:
        """Raises UnansweredError, who is missing, when the robot is not heard."""
        self._link = link
        with link.subscribed(STATUS, TRUTH) as heard:
            link.wait(lambda: all(heard.latest(topic) for topic in (STATUS, TRUTH)), LISTEN_NS)
            now_ns = link.clock.now_ns()
            status, self._truth = heard.live(STATUS, now_ns), heard.live(TRUTH, now_ns)
        if status is None:
            raise UnansweredError(link.diagnosis())
        self.status: NavigatorStatus = status

    def instant(self, world: str | None, goal: Destination | None) -> BranchPoint:
        """`world` and `goal` instead of those in force; only a simulation knows the truth."""
        truth = self._truth
        if truth is None:
            raise UserError("no simulation tells where the robot truly is: a ghost needs one")
        pose, whereto = (truth.x_m, truth.y_m, truth.heading_rad), goal or goal_of(self.status)
        return BranchPoint(world or self.world(), pose, truth.time_ns / NS_PER_S, whereto)

    def world(self) -> Facts:
        answer = self._link.bus.ask(WORLD, timeout_s=ASK_S, robot=self._link.robot)
        try:
            facts: Any = value_in(answer) if isinstance(answer, bytes) else None
        except ValueError:
            facts = None
        if not isinstance(facts, dict):
            raise RemoteError("the plant answers, but not with its world")
        return facts

    def parameters(self) -> dict[str, float]:
        return driving(changed(fetch(self._link)))

    def rest(self) -> PredictedPath:
        """It drives on; how that ends is not known yet."""
        return PredictedPath([], DRIVING, "", None, None)
