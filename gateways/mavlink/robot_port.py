"""The interface of the protocols to one robot: its newest telemetry, requests, and the lease.

The telemetry also tells why the robot cannot be armed.
"""

from collections.abc import Awaitable, Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, Final, NamedTuple, Protocol

from ground.client.outcomes import Operation, Outcome, Refused
from ground.commands.abort import Abort
from ground.commands.disarm import Disarm
from ground.commands.hold import Hold
from protocol.wire.enums import LeaseAction, Vehicle
from protocol.wire.messages import (
    CycleReport,
    LeaseStatus,
    MissionStatus,
    NavigatorStatus,
    PlanarOdometry,
    SonarScan,
    Statustext,
    WheelTicks,
)
from protocol.wire.reasons import Reason, reason_text

STOPS: Final = (Abort, Disarm, Hold)
"""What only stops the robot. It needs neither control nor the lease, and overtakes what waits."""
NO_TELEMETRY: Final = "no telemetry arrives from the robot"
"""Why a request is refused at once while the robot is silent."""
OVERTAKEN: Final = "the robot was stopped before this could begin: send it again"
"""Why a request that was asked before a stop, and waited, is refused."""
KEEPS_FENCE: Final = "the fence is removed only while the robot is disarmed"
HINTS: Final[Mapping[int, str]] = MappingProxyType(
    {
        Reason.EMERGENCY_STOPPED: "command 185 with 0 clears it, forced arming too",
        Reason.NO_GOAL: "Send a goal first",
        Reason.PLACE_UNKNOWN: "sidestep pose set X Y DEG, in a shell",
        Reason.PARAMETERS_DAMAGED: "set one of the safety group",
    }
)
"""Remedies for refusals, in terms of MAVLink ground stations."""


class Snapshot(NamedTuple):
    """The newest telemetry of a robot. A message that is stale or has never arrived is None."""

    now_ns: int
    status: NavigatorStatus | None = None
    odometry: PlanarOdometry | None = None
    scan: SonarScan | None = None
    wheels: WheelTicks | None = None
    lease: LeaseStatus | None = None
    mission: MissionStatus | None = None
    cycle: CycleReport | None = None

    @property
    def is_live(self) -> bool:
        """True if the robot's status is arriving."""
        return self.status is not None


@dataclass(frozen=True, slots=True)
class Answered:
    """The end of a request: its outcome, or None with the error if the robot did not answer.

    An `error` beside an outcome says it in other words.
    """

    outcome: Outcome | None
    error: str = ""

    @property
    def ok(self) -> bool:
        """True if the robot accepted."""
        return self.outcome is not None and self.outcome.ok

    @property
    def text(self) -> str:
        """The outcome or the error, as a text for the user of a MAVLink ground station."""
        if self.error or self.outcome is None:
            return self.error
        if isinstance(self.outcome, Refused):
            return self.outcome.in_words(HINTS)
        return self.outcome.text

    @property
    def why(self) -> str:
        """Why it failed, for a line that tells what was refused."""
        if not self.error and isinstance(self.outcome, Refused):
            return self.outcome.why(HINTS)
        return self.text


class StopPress(NamedTuple):
    """An emergency stop that was sent; `ended` is None if nobody waits for its acknowledgement."""

    request_id: int
    ended: Awaitable[Answered] | None


Refusal = Callable[[], Outcome | None]
"""Returns why a request is refused after all, when its turn comes; None if it is not."""


def permitted() -> Outcome | None:
    """Refuse nothing."""
    return None


class RobotPort(Protocol):
    """One robot. No call blocks."""

    @property
    def name(self) -> str:
        """The robot's name on the bus."""

    @property
    def identity(self) -> str:
        """The gateway's operator identity, as the holder in a lease status."""

    def snapshot(self, now_ns: int) -> Snapshot:
        """Return the newest telemetry."""

    def need_wheels(self, now_ns: int) -> None:
        """Keep the encoders in the snapshot up to date for some time; else they are sampled."""

    def new_texts(self) -> list[Statustext]:
        """Return the robot's texts, in pieces, that have arrived since the last call."""

    async def perform(
        self, operation: Operation[Any], name: str = "", refusal: Refusal = permitted
    ) -> Answered:
        """Perform an operation, unless there is a refusal at its turn.

        Operations of one robot run one after another. `name` is that of the client that asks, for
        other operators.
        """

    async def change_lease(self, action: LeaseAction, name: str) -> Answered:
        """Take, seize or release the lease for a client with this name."""

    def stop(self) -> StopPress:
        """Send the emergency stop before this returns; repeat it until telemetry shows it.

        Its id is what a clear names.
        """

    def heartbeat(self) -> None:
        """Send one operator's heartbeat."""

    def drive(self, speed_m_s: float, yaw_rate_rad_s: float) -> None:
        """Send speeds for MANUAL once; they expire after 250 ms."""


EMERGENCY_STOPPED: Final = (
    f"{reason_text(Reason.EMERGENCY_STOPPED)} ({HINTS[Reason.EMERGENCY_STOPPED]})"
)


def arming_faults(snapshot: Snapshot) -> tuple[str, ...]:
    """Return the reasons as texts; none if the robot can be armed or is armed.

    Arming again ends a failsafe, so a failsafe is no reason while sensor data arrive.
    """
    status = snapshot.status
    if status is None:
        return (NO_TELEMETRY,)
    if status.vehicle == Vehicle.EMERGENCY_STOP:
        return (EMERGENCY_STOPPED,)
    if status.vehicle == Vehicle.BOOT or snapshot.scan is None or snapshot.wheels is None:
        return (reason_text(Reason.NO_SENSES),)
    if status.vehicle_reason == Reason.FENCE_UNREADABLE:
        return (reason_text(Reason.FENCE_UNREADABLE),)
    return ()
