"""The public names of `import sidestep`.

The asyncio client with its values, messages, events and errors; trials and studies in simulated
time, worlds, and recordings. What simulates is imported at its first use: a client needs none of
it.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any, Final

import sidestep.operations as operations
from ground.client.events import (
    Event,
    EventStream,
    GoalChanged,
    LeaseChanged,
    MissionChanged,
    ModeChanged,
    TextReceived,
    VehicleChanged,
)
from ground.client.missions import MissionEnded, TransferOutcome
from ground.client.outcomes import (
    Accepted,
    AllAnswered,
    DriveEnded,
    GoalEnded,
    Outcome,
    Refused,
    RefusedError,
    Stopped,
    agreed,
)
from ground.client.parameter import Parameter
from ground.client.parameters import ParameterChanged
from ground.client.robot_link import UnansweredError
from ground.client.streams import ClosedError, Stream
from ground.missions.mission import Circle, MavlinkItem, Mission, Polygon, Waypoint, Zones
from ground.robot import Robot, connect
from protocol.wire.enums import GoalState, MissionState, Mode, Navigator, Severity, Vehicle
from protocol.wire.message import Message
from protocol.wire.messages import (
    AvoidanceDecision,
    GroundTruth,
    Heartbeat,
    NavigatorStatus,
    PlanarOdometry,
    SonarScan,
    Statustext,
    WheelCommand,
    WheelTicks,
)
from protocol.wire.reasons import Reason
from runtime.errors import ConfigError, RemoteError, UserError

if TYPE_CHECKING:
    from sidestep.recording import Recording, open_recording
    from sidestep.simulation import StudyResult, TrialResult, World, study, trial, worlds
    from sidestep.table import Table
else:
    LATER: Final = {
        **dict.fromkeys(("Recording", "open_recording"), "sidestep.recording"),
        **dict.fromkeys(("StudyResult", "TrialResult", "World"), "sidestep.simulation"),
        **dict.fromkeys(("study", "trial", "worlds"), "sidestep.simulation"),
        "Table": "sidestep.table",
    }

    def __getattr__(name: str) -> Any:
        """Import what simulates, or reads recordings."""
        if name not in LATER:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        return getattr(import_module(LATER[name]), name)


__all__ = [
    "Accepted",
    "AllAnswered",
    "AvoidanceDecision",
    "Circle",
    "ClosedError",
    "ConfigError",
    "DriveEnded",
    "Event",
    "EventStream",
    "GoalChanged",
    "GoalEnded",
    "GoalState",
    "GroundTruth",
    "Heartbeat",
    "LeaseChanged",
    "MavlinkItem",
    "Message",
    "Mission",
    "MissionChanged",
    "MissionEnded",
    "MissionState",
    "Mode",
    "ModeChanged",
    "Navigator",
    "NavigatorStatus",
    "Outcome",
    "Parameter",
    "ParameterChanged",
    "PlanarOdometry",
    "Polygon",
    "Reason",
    "Recording",
    "Refused",
    "RefusedError",
    "RemoteError",
    "Robot",
    "Severity",
    "SonarScan",
    "Statustext",
    "Stopped",
    "Stream",
    "StudyResult",
    "Table",
    "TextReceived",
    "TransferOutcome",
    "TrialResult",
    "UnansweredError",
    "UserError",
    "Vehicle",
    "VehicleChanged",
    "Waypoint",
    "WheelCommand",
    "WheelTicks",
    "World",
    "Zones",
    "agreed",
    "connect",
    "open_recording",
    "operations",
    "study",
    "trial",
    "worlds",
]
