"""The rows of the commands of `ground/commands/`: made by `make generate`, not by hand."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final

from runtime.cli.verb import Verb

COMMANDS: Final[Mapping[str, Verb]] = MappingProxyType(
    {
        "hold": Verb(
            section="start and drive",
            summary="stop and keep the goal",
            example="hold",
            module="ground.commands.hold",
            words="Hold",
            rank=50,
        ),
        "resume": Verb(
            section="start and drive",
            summary="continue to the goal",
            example="resume",
            module="ground.commands.resume",
            words="Resume",
            rank=60,
        ),
        "abort": Verb(
            section="start and drive",
            summary="stop and drop the goal",
            example="abort --id r2",
            module="ground.commands.abort",
            words="Abort",
            rank=70,
        ),
        "rtl": Verb(
            section="start and drive",
            summary="drive back along the robot's own trail",
            example="rtl",
            module="ground.commands.rtl",
            words="ReturnHome",
            rank=80,
        ),
        "arm": Verb(
            section="start and drive",
            summary="arm the motors",
            example="arm",
            module="ground.commands.arm",
            words="Arm",
            rank=90,
        ),
        "disarm": Verb(
            section="start and drive",
            summary="disarm the motors",
            example="disarm",
            module="ground.commands.disarm",
            words="Disarm",
            rank=100,
        ),
        "mode": Verb(
            section="start and drive",
            summary="choose the mode",
            example="mode auto",
            module="ground.commands.mode",
            words="SetMode",
            rank=130,
        ),
        "navigator": Verb(
            section="start and drive",
            summary="choose the navigator",
            example="navigator bug left",
            module="ground.commands.navigator",
            words="SetNavigator",
            rank=140,
        ),
        "mark": Verb(
            section="rec",
            summary="add a remark to the recording",
            example="rec mark the door is closed now",
            module="ground.commands.mark",
            words="Mark",
            rank=30,
        ),
    }
)
