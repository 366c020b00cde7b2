"""Frozen values, one for each operation of an operator; `perform(session)` carries it out.

The constructor checks the values: UserError names one that is out of range. `moves` is True if an
operation can move the robot or change how it moves.
"""

from typing import Protocol, TypeVar

from ground.client.operations.all_robots import AllAnswered, ClearAll, StopAll
from ground.client.operations.commands import (
    COMMANDS,
    Abort,
    Arm,
    ClearEmergencyStop,
    Disarm,
    Hold,
    Mark,
    Marked,
    Restart,
    Resume,
    ReturnHome,
    SetMode,
    SetNavigator,
    StopNow,
    Stopped,
)
from ground.client.operations.fences import ClearFence, FenceShown, SetFence, ShowFence
from ground.client.operations.goals import GoalEnded, Goto
from ground.client.operations.leases import ChangeLease, LeaseShown, ShowLease
from ground.client.operations.missions import (
    AnnounceItems,
    ClearMission,
    DownloadMission,
    FetchMission,
    JumpTo,
    MissionEnded,
    MissionFetched,
    MissionProgress,
    MissionWritten,
    ShowMissionStatus,
    StartMission,
    TransferOutcome,
    UploadMission,
)
from ground.client.operations.parameters import (
    LoadParameters,
    ParameterChanged,
    ParametersLoaded,
    ParametersSaved,
    ParameterTable,
    ResetParameter,
    SaveParameters,
    SetParameter,
    ShowParameters,
)
from ground.client.operations.place import SetPose, SetTruePose
from ground.client.operations.session import NoProgress, Progress, Session
from ground.client.operations.teleop import DriveByHand, DriveEnded
from ground.client.results import Outcome

O_co = TypeVar("O_co", bound=Outcome, covariant=True)


class Operation(Protocol[O_co]):
    """Something that an operator can do with a robot."""

    @property
    def verb(self) -> str:
        """The name of the operation on the command line."""

    @property
    def moves(self) -> bool:
        """True if it can move the robot or change how it moves."""

    def perform(self, session: Session) -> O_co:
        """Carry it out and return the outcome.

        Raises UserError, RemoteError or UnansweredError if there is no outcome.
        """


__all__ = [
    "COMMANDS",
    "Abort",
    "AllAnswered",
    "AnnounceItems",
    "Arm",
    "ChangeLease",
    "ClearAll",
    "ClearEmergencyStop",
    "ClearFence",
    "ClearMission",
    "Disarm",
    "DownloadMission",
    "DriveByHand",
    "DriveEnded",
    "FenceShown",
    "FetchMission",
    "GoalEnded",
    "Goto",
    "Hold",
    "JumpTo",
    "LeaseShown",
    "LoadParameters",
    "Mark",
    "Marked",
    "MissionEnded",
    "MissionFetched",
    "MissionProgress",
    "MissionWritten",
    "NoProgress",
    "Operation",
    "ParameterChanged",
    "ParameterTable",
    "ParametersLoaded",
    "ParametersSaved",
    "Progress",
    "ResetParameter",
    "Restart",
    "Resume",
    "ReturnHome",
    "SaveParameters",
    "Session",
    "SetFence",
    "SetMode",
    "SetNavigator",
    "SetParameter",
    "SetPose",
    "SetTruePose",
    "ShowFence",
    "ShowLease",
    "ShowMissionStatus",
    "ShowParameters",
    "StartMission",
    "StopAll",
    "StopNow",
    "Stopped",
    "TransferOutcome",
    "UploadMission",
]
