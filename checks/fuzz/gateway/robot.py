"""A simulated robot: it accepts, refuses or does not answer."""

import json
from collections import deque
from pathlib import Path
from typing import Any, Final

from gateways.mavlink.coordinates import DEFAULT_ORIGIN
from gateways.mavlink.mav_vehicle import Face, MavVehicle
from gateways.mavlink.robot_port import Answered, Done, Snapshot
from gateways.mavlink.services import face_of
from gateways.mavlink.signing import SigningGuard
from ground.client.operations.fences import ClearFence, FenceShown, SetFence, ShowFence
from ground.client.operations.missions import (
    ClearMission,
    FetchMission,
    MissionFetched,
    TransferOutcome,
    UploadMission,
)
from ground.client.operations.parameters import ParameterTable, ShowParameters
from ground.client.operations.session import Operation
from ground.client.parameter import parameters_in
from ground.client.results import Accepted, Outcome, Refused
from ground.missions.mission import Circle, Mission, Waypoint
from ground.missions.transfer import Verdict
from protocol.wire.enums import GoalState, LeaseAction, MissionState, Mode, Navigator
from protocol.wire.enums import Vehicle as State
from protocol.wire.messages import (
    GatewayStatus,
    MissionStatus,
    NavigatorStatus,
    PlanarOdometry,
    SonarScan,
    Statustext,
)
from protocol.wire.reasons import Reason
from robot.core.parameters import DEFAULTS
from robot.parameter_table import described

SILENT, ARMED = 0x20, 0x40
"""Bits of the flags: no telemetry arrives, the robot is armed. Bits 3 and 4 choose the answer."""
ANSWERS: Final[tuple[Answered | None, ...]] = (
    Answered(Accepted(1)),
    Answered(Refused(Reason.LEASE_HELD, 1)),
    Answered(None, "r1 does not answer"),
    None,
)
SCAN: Final = SonarScan(
    time_ns=5, seq=1, range_mm=(900,) * 8, ping_age_us=(20_000,) * 8, valid=255, echo=60
)
PLACE: Final = dict.fromkeys(PlanarOdometry.__struct_fields__, 0.25)
STATUS: Final[dict[str, Any]] = dict.fromkeys(NavigatorStatus.__struct_fields__, 0) | {
    "mode": Mode.GUIDED,
    "goal": GoalState.NONE,
    "navigator": Navigator.VGM,
    "side": 1,
}
MISSION: Final = MissionStatus(
    time_ns=5, mission_id=1, hold_left_ms=0, count=2, current=0, state=MissionState.READY, reason=0
)
WAYPOINTS: Final = (Waypoint(x_m=1.0, y_m=2.0), Waypoint(x_m=3.0, y_m=4.0, heading_deg=90.0))
KEPT: Final = TransferOutcome(verdict=Verdict(Reason.NONE, None, 1), done="")
MISSION_ANSWERS: Final[dict[type, Outcome]] = {
    FetchMission: MissionFetched(Mission(waypoints=WAYPOINTS)),
    ShowFence: FenceShown(Circle(x_m=0.0, y_m=0.0, radius_m=5.0)),
    **dict.fromkeys((UploadMission, ClearMission, SetFence, ClearFence), KEPT),
}


class SimulatedRobot:
    """A robot whose answers depend on the flags of the last message."""

    name = "r1"
    identity = "gateway/1"

    def __init__(self) -> None:
        self.flags = 0
        self._waiting: deque[tuple[Done, Operation[Any] | None]] = deque()

    def snapshot(self, now_ns: int) -> Snapshot:
        """Return telemetry, or none of it."""
        if self.flags & SILENT:
            return Snapshot(now_ns)
        state = State.ACTIVE if self.flags & ARMED else State.STANDBY
        status = NavigatorStatus(**{**STATUS, "time_ns": now_ns, "vehicle": state})
        place = PlanarOdometry(**{**PLACE, "time_ns": now_ns})  # type: ignore[arg-type]
        return Snapshot(now_ns, status=status, odometry=place, scan=SCAN, mission=MISSION)

    def new_texts(self) -> list[Statustext]:
        """Return no texts."""
        return []

    def perform(self, operation: Operation[Any], done: Done) -> None:
        """Keep the request."""
        self._waiting.append((done, operation))

    def change_lease(self, action: LeaseAction, name: str, done: Done) -> None:
        """Keep the request."""
        self._waiting.append((done, None))

    def stop(self, done: Done) -> int:
        """Keep the request."""
        self._waiting.append((done, None))
        return len(self._waiting)

    def heartbeat(self) -> None:
        """Ignore the heartbeat."""

    def drive(self, speed_m_s: float, yaw_rate_rad_s: float) -> None:
        """Ignore the speeds."""

    def report(self, status: GatewayStatus) -> None:
        """Ignore the state of the gateway."""

    def deliver(self) -> None:
        """Answer the waiting requests."""
        answer = ANSWERS[self.flags >> 3 & 3]
        for _ in range(len(self._waiting) if answer is not None else 0):
            done, operation = self._waiting.popleft()
            assert answer is not None, "checked above"
            done(accepted(operation) if answer is ANSWERS[0] else answer)


def accepted(operation: Operation[Any] | None) -> Answered:
    """Return the answer of a robot that accepts."""
    if isinstance(operation, ShowParameters):
        return Answered(LIST)
    return Answered(MISSION_ANSWERS.get(type(operation), Accepted(1)))


def robots_list() -> Outcome:
    """Return the robot's parameters."""
    return ParameterTable(tuple(parameters_in(json.dumps(described(DEFAULTS)))))


LIST: Final = robots_list()


def new_face(
    folder: Path | None = None, guard: SigningGuard | None = None
) -> tuple[Face, SimulatedRobot]:
    """Return a vehicle with two clients."""
    robot = SimulatedRobot()
    face = face_of(MavVehicle(1, robot, DEFAULT_ORIGIN, 0), folder, guard)
    for client in (1, 2):
        face.join(client)
    return face, robot
