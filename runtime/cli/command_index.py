"""The rows of the commands of `ground/commands/`: made by `make generate`, not by hand."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final

from runtime.cli.verb import Subcommand, Verb

COMMANDS: Final[Mapping[str, Verb]] = MappingProxyType(
    {
        "goto": Verb(
            section="start and drive",
            summary="drive to X Y [DEG] and wait for the outcome",
            example="goto 5.4 2 90 --timeout 60",
            module="ground.commands.goto",
            words="Goto",
            rank=40,
            also=MappingProxyType({"goal": ()}),
        ),
        "hold": Verb(
            section="start and drive",
            summary="stop and keep the goal",
            example="hold",
            module="ground.commands.hold",
            words="Hold",
            rank=50,
            only_stops=True,
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
            summary="stop and end the goal; `resume` can go on to it later",
            example="abort --id r2",
            module="ground.commands.abort",
            words="Abort",
            rank=70,
            only_stops=True,
        ),
        "rtl": Verb(
            section="start and drive",
            summary="drive back along the robot's own trail",
            example="rtl",
            module="ground.commands.rtl",
            words="ReturnHome",
            rank=80,
            also=MappingProxyType({"mode rtl": ()}),
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
            only_stops=True,
        ),
        "estop": Verb(
            section="start and drive",
            summary="emergency stop, latched",
            example="estop --all",
            module="ground.commands.stop",
            words="StopNow",
            rank=110,
            also=MappingProxyType({"stop": ()}),
            only_stops=True,
        ),
        "clear-estop": Verb(
            section="start and drive",
            summary="release the emergency stop",
            example="clear-estop --all",
            module="ground.commands.stop",
            words="ClearEmergencyStop",
            rank=120,
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
            also=MappingProxyType({"algo": ()}),
        ),
        "teleop": Verb(
            section="start and drive",
            summary="drive by hand at a speed and a turn",
            example="teleop 0.2 15 --for 3",
            module="ground.commands.teleop",
            words="DriveByHand",
            rank=150,
        ),
        "watch": Verb(
            section="look",
            summary="print telemetry and texts as lines",
            example="watch --once",
            module="ground.commands.watch",
            words="Watch",
            rank=10,
        ),
        "doctor": Verb(
            section="look",
            summary="find problems, and how to fix them",
            example="doctor --timeout 5",
            module="ground.commands.doctor",
            words="Diagnose",
            rank=30,
        ),
        "explain": Verb(
            section="look",
            summary="show why the robot turns, live or in a recording",
            example="explain drive.mcap --at 12.5",
            module="ground.commands.explain",
            words="Explain",
            rank=40,
            suffixes=(".tlog", ".mcap"),
        ),
        "share": Verb(
            section="look",
            summary="put a recording, its plot and its explanation into one .zip",
            example="share drive.mcap --out drive.zip",
            module="ground.commands.share",
            words="Share",
            rank=70,
            suffixes=(".tlog", ".mcap"),
        ),
        "recordings": Verb(
            section="rec",
            summary="list the recordings, the newest first",
            example="rec list --json",
            module="ground.commands.recordings",
            words="ListRecordings",
            rank=20,
            name="list",
        ),
        "mark": Verb(
            section="rec",
            summary="add a remark to the recording",
            example="rec mark the door is closed now",
            module="ground.commands.mark",
            words="Mark",
            rank=30,
            also=MappingProxyType({"record mark": ()}),
        ),
        "export": Verb(
            section="rec",
            summary="convert a recording to a CSV or Parquet table, or to a bag of ROS 2",
            example="rec export drive.mcap --out drive.csv",
            module="ground.commands.export",
            words="Export",
            rank=40,
            suffixes=(".tlog", ".mcap"),
        ),
        "plot": Verb(
            section="rec",
            summary="draw a recorded run as a picture",
            example="rec plot drive.mcap --out drive.svg",
            module="ground.commands.plot",
            words="Plot",
            rank=50,
            suffixes=(".tlog", ".mcap"),
        ),
        "param": Verb(
            section="groups",
            summary="read and set the robot's parameters",
            example="param set d_obs_m 0.35",
            module="ground.commands.param",
            words="PARAM",
            rank=10,
            suffixes=(".toml", ".param", ".parm", ".params"),
            subcommands=MappingProxyType(
                {
                    "list": Subcommand(
                        "all parameters, with unit, range, default and meaning",
                        "param list",
                    ),
                    "get": Subcommand(
                        "parameters whose name matches, as in 'sonar_*'",
                        "param get 'sonar_*'",
                        also=MappingProxyType({"get": ()}),
                    ),
                    "diff": Subcommand(
                        "parameters that differ from their defaults",
                        "param diff --json",
                    ),
                    "set": Subcommand(
                        "set one parameter; a robot with --state saves it",
                        "param set d_obs_m 0.35",
                        also=MappingProxyType({"set": ()}),
                    ),
                    "reset": Subcommand(
                        "set one parameter to its default value",
                        "param reset d_obs_m",
                    ),
                    "save": Subcommand(
                        "write the changed parameters to a .toml or .param file",
                        "param save tuned.toml",
                    ),
                    "load": Subcommand(
                        "set all values of a file, if all are allowed",
                        "param load tuned.toml",
                    ),
                }
            ),
        ),
        "mission": Verb(
            section="groups",
            summary="waypoints: check, send, start, pause, jump, fetch, convert",
            example="mission upload mission.toml",
            module="ground.commands.mission",
            words="MISSION",
            rank=20,
            suffixes=(".toml", ".plan", ".waypoints"),
            subcommands=MappingProxyType(
                {
                    "check": Subcommand(
                        "report the faults of a mission file",
                        "mission check mission.toml",
                    ),
                    "upload": Subcommand(
                        "send a mission and its fence, if any, to the robot",
                        "mission upload mission.toml",
                        also=MappingProxyType({"wp upload": ("-",)}),
                    ),
                    "download": Subcommand(
                        "write the robot's mission to a file",
                        "mission download fetched.plan",
                    ),
                    "list": Subcommand(
                        "show the items of the robot's mission",
                        "mission list --json",
                    ),
                    "start": Subcommand(
                        "drive the mission, from an item on",
                        "mission start 2",
                        also=MappingProxyType({"mission restart": ("1",)}),
                    ),
                    "pause": Subcommand(
                        "stop, and keep the mission",
                        "mission pause",
                    ),
                    "resume": Subcommand(
                        "continue the mission",
                        "mission resume",
                    ),
                    "abort": Subcommand(
                        "cancel the mission and stop",
                        "mission abort --id r2",
                    ),
                    "jump": Subcommand(
                        "continue with another item",
                        "mission jump 3",
                    ),
                    "status": Subcommand(
                        "show the progress of the mission",
                        "mission status --json",
                    ),
                    "clear": Subcommand(
                        "delete the mission from the robot",
                        "mission clear --id r2",
                    ),
                    "convert": Subcommand(
                        "convert between formats of mission files, chosen by the suffixes",
                        "mission convert mission.toml mission.plan",
                    ),
                }
            ),
        ),
        "fence": Verb(
            section="groups",
            summary="keep the robot inside of a circle or polygon",
            example="fence circle 3 2 2.5",
            module="ground.commands.fence",
            words="FENCE",
            rank=30,
            subcommands=MappingProxyType(
                {
                    "circle": Subcommand(
                        "stay within R metres of X Y",
                        "fence circle 3 2 2.5",
                    ),
                    "polygon": Subcommand(
                        "stay inside these corners",
                        "fence polygon 0 0 6 0 6 4 0 4",
                    ),
                    "off": Subcommand(
                        "remove the fence",
                        "fence off",
                    ),
                    "show": Subcommand(
                        "show the robot's fence",
                        "fence show --json",
                    ),
                }
            ),
        ),
        "pose": Verb(
            section="groups",
            summary="set the pose of a robot that has lost its place",
            example="pose set 2 1.5 90",
            module="ground.commands.pose",
            words="POSE",
            rank=40,
            subcommands=MappingProxyType(
                {
                    "set": Subcommand(
                        "set the pose of the robot to X Y [DEG]",
                        "pose set 2 1.5 90",
                    ),
                    "truth": Subcommand(
                        "set the pose of a simulated robot to the true one",
                        "pose truth",
                    ),
                }
            ),
        ),
        "lease": Verb(
            section="groups",
            summary="take or give back control of the robot, or show who has it",
            example="lease take --for 60",
            module="ground.commands.lease",
            words="ChangeLease",
            rank=50,
        ),
    }
)
