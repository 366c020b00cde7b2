"""The public names of `sidestep.operations`: all operations, and their outcomes."""

from ground.client.missions import MissionEnded, MissionProgress, TransferOutcome
from ground.client.outcomes import (
    AllAnswered,
    DriveEnded,
    GoalEnded,
    LeaseShown,
    Marked,
    NoProgress,
    Operation,
    Progress,
    Stopped,
)
from ground.client.parameters import ParameterChanged, ParametersLoaded, ParametersSaved
from ground.commands.abort import Abort
from ground.commands.arm import Arm
from ground.commands.disarm import Disarm
from ground.commands.fence import ClearFence, FenceShown, SetFence, ShowFence
from ground.commands.goto import Goto
from ground.commands.hold import Hold
from ground.commands.lease import ChangeLease, ShowLease
from ground.commands.mark import Mark
from ground.commands.mission import (
    AnnounceItems,
    ClearMission,
    DownloadMission,
    FetchMission,
    JumpTo,
    MissionFetched,
    MissionWritten,
    ShowMissionStatus,
    StartMission,
    UploadMission,
)
from ground.commands.mode import SetMode
from ground.commands.navigator import SetNavigator
from ground.commands.param import (
    LoadParameters,
    ParameterTable,
    ResetParameter,
    SaveParameters,
    SetParameter,
    ShowChanged,
    ShowParameters,
    ShowValues,
)
from ground.commands.pose import SetPose, SetTruePose
from ground.commands.restart import Restart
from ground.commands.resume import Resume
from ground.commands.rtl import ReturnHome
from ground.commands.stop import ClearAll, ClearEmergencyStop, StopAll, StopNow
from ground.commands.teleop import DriveByHand

__all__ = [
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
    "SetFence",
    "SetMode",
    "SetNavigator",
    "SetParameter",
    "SetPose",
    "SetTruePose",
    "ShowChanged",
    "ShowFence",
    "ShowLease",
    "ShowMissionStatus",
    "ShowParameters",
    "ShowValues",
    "StartMission",
    "StopAll",
    "StopNow",
    "Stopped",
    "TransferOutcome",
    "UploadMission",
]
