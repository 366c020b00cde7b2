"""The public names of `import sidestep`: the asyncio client, its values, events and errors."""

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
from protocol.wire.reasons import Reason
from runtime.errors import ConfigError, RemoteError, UserError

__all__ = [
    "Accepted",
    "AllAnswered",
    "Circle",
    "ClosedError",
    "ConfigError",
    "DriveEnded",
    "Event",
    "EventStream",
    "GoalChanged",
    "GoalEnded",
    "GoalState",
    "LeaseChanged",
    "MavlinkItem",
    "Mission",
    "MissionChanged",
    "MissionEnded",
    "MissionState",
    "Mode",
    "ModeChanged",
    "Navigator",
    "Outcome",
    "Parameter",
    "ParameterChanged",
    "Polygon",
    "Reason",
    "Refused",
    "RefusedError",
    "RemoteError",
    "Robot",
    "Severity",
    "Stopped",
    "Stream",
    "TextReceived",
    "TransferOutcome",
    "UnansweredError",
    "UserError",
    "Vehicle",
    "VehicleChanged",
    "Waypoint",
    "Zones",
    "agreed",
    "connect",
    "operations",
]
