"""Keep a robot driving whatever happens to it, even after it has lost its position.

Each goal is relative to the estimated position: straight on after a goal was reached, else in
another direction. So a robot that was restarted on its way continues like the others.
"""

from math import cos, sin
from typing import Final

from checks.endurance.fleet_telemetry import RobotTelemetry
from checks.harness.bus_calls import arm_request, is_accepted
from ground.client.goal import Destination, goal_request
from ground.client.requests import RequestIds
from protocol.bus.bus import Bus
from protocol.topics import COMMAND
from protocol.wire.enums import GoalState, Mode, Vehicle
from protocol.wire.message import Message
from protocol.wire.messages import PlanarOdometry
from runtime.errors import RemoteError

PATIENCE_S: Final = 0.2
EVERY_NS: Final = 1_000_000_000
STEP_M: Final = 1.2
BACK_RAD: Final = 2.6
"""Not quite back, so that the robot does not drive to and fro between two walls."""
LONGEST_NS: Final = 12_000_000_000
UNDER_WAY: Final = (
    GoalState.ACCEPTED,
    GoalState.DRIVING,
    GoalState.AVOIDING,
    GoalState.ALIGNING,
)


class GoalSender:
    """Sends the next goal when the last has ended or takes too long; arms the robot if needed."""

    def __init__(self, bus: Bus, robot: str) -> None:
        self.robot = robot
        self.goals = self.reached = 0
        self._bus = bus
        self._ids = RequestIds()
        self._due_ns = 0
        self._given_ns = 0
        self._turn_rad = 0.0

    def poll(self, telemetry: RobotTelemetry, now_ns: int) -> None:
        """Send a goal if one is due, at most once a second and not while the robot is silent."""
        status, pose = telemetry.status, telemetry.pose
        if status is None or pose is None or now_ns < self._due_ns:
            return
        self._due_ns = now_ns + EVERY_NS
        if telemetry.silent_since(now_ns - EVERY_NS):
            return
        under_way = status.vehicle == Vehicle.ACTIVE and status.goal in UNDER_WAY
        if under_way and now_ns - self._given_ns < LONGEST_NS:
            return
        arrived = status.goal == GoalState.REACHED
        begins = self._given_ns == 0
        self.reached += arrived and not begins
        self._turn_rad = 0.0 if arrived or begins else self._turn_rad + BACK_RAD
        if status.vehicle != Vehicle.ACTIVE:
            self._ask(arm_request(self._ids.next()))
        if self._ask(self._goal(pose)):
            self.goals += 1
            self._given_ns = now_ns

    def _goal(self, pose: PlanarOdometry) -> Message:
        heading_rad = pose.heading_rad + self._turn_rad
        there = Destination(
            x_m=pose.x_m + STEP_M * cos(heading_rad),
            y_m=pose.y_m + STEP_M * sin(heading_rad),
            heading_rad=None,
        )
        return goal_request(there.on_the_wire(), self._ids.next(), Mode.AUTO, from_robot=True)

    def _ask(self, request: Message) -> bool:
        """Send a request and return whether it was accepted."""
        try:
            return is_accepted(self._bus.ask(COMMAND, request, PATIENCE_S, robot=self.robot))
        except RemoteError:
            return False
