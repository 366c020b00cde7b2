"""The table of all verbs of `sidestep`: group, summary, example and implementation of each.

The executable, the parsers, `--help`, shell completion, the reference and the app's command line
read this table. It names modules and imports none, so that a process loads only the verb it runs.
"""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final, NamedTuple

from runtime.cli import subcommand_table
from runtime.cli.subcommand_table import Subcommand

DRIVE: Final = "start and drive"
LOOK: Final = "look"
TEST: Final = "test"
RUN: Final = "run"
REC: Final = "rec"
MORE: Final = "groups"
GROUPS: Final[Mapping[str, str]] = MappingProxyType(
    {
        RUN: "one: plant, robot, router, gateway, container, health, bridge",
        REC: "recordings: start, list, mark, export, plot, reexecute",
    }
)
"""Verbs of these sections are below their group, as in `sidestep rec plot`."""
COMMANDS: Final = "ground.grammar.commands"
DRIVING: Final = "ground.grammar.driving"
LOOKING: Final = "ground.grammar.looking"
OF_RECORDINGS: Final = "ground.grammar.recordings"
RECORDINGS: Final = (".tlog", ".mcap")
MISSIONS: Final = (".toml", ".plan", ".waypoints")


class Verb(NamedTuple):
    """A verb, with the names of its module and of the functions in it.

    `section` is a heading of the help, or the group that the verb belongs to. `example` is a
    command line without `sidestep`. `words` is the class that parses a typed operation, for the
    shell and for the app's command line. Other verbs of an operator parse `arguments` and then
    either run by themselves (`run`) or act over a link to a robot (`act`). A verb with none of
    these is a program with a `main` and a `parser`. `name` is the word in the group, if it is not
    the key of the table; `suffixes` are those of its argument `file`, and `subcommands` the words
    that follow the verb, as in `mission upload`; `hosts` are modules that register where a program
    can run, by the option that needs them.
    """

    section: str
    summary: str
    example: str
    module: str
    act: str = ""
    run: str = ""
    arguments: str = "arguments"
    words: str = ""
    name: str = ""
    suffixes: tuple[str, ...] = ()
    subcommands: Mapping[str, Subcommand] = MappingProxyType({})
    hosts: Mapping[str, str] = MappingProxyType({})

    @property
    def is_program(self) -> bool:
        """True for a verb whose module has its own `main`."""
        return not (self.act or self.run or self.words)

    @property
    def is_grouped(self) -> bool:
        """True for a verb below a group."""
        return self.section in GROUPS


VERBS: Final[Mapping[str, Verb]] = MappingProxyType(
    {
        "up": Verb(
            DRIVE,
            "start plant and robot, drive to a goal, report the outcome",
            "up --world box --navigator bug",
            "ground.cli.run.up",
            run="run",
        ),
        "tutorial": Verb(
            DRIVE,
            "the first ten minutes: a drive with a guide on the screen",
            "tutorial",
            "ground.cli.run.tutorial",
            run="run",
        ),
        "ground": Verb(
            DRIVE,
            "the ground station, in this terminal or in a browser",
            "ground --web 8765 --no-record",
            "ground.cli.run.ground",
            act="act_ground",
            run="run_ground",
            arguments="ground_arguments",
        ),
        "goto": Verb(
            DRIVE,
            "drive to X Y [DEG] and wait for the outcome",
            "goto 5.4 2 90 --timeout 60",
            DRIVING,
            words="GotoWords",
        ),
        "hold": Verb(DRIVE, "stop and keep the goal", "hold", COMMANDS, words="CommandWords"),
        "resume": Verb(
            DRIVE, "continue to the goal", "resume", COMMANDS, words="LeasedCommandWords"
        ),
        "abort": Verb(
            DRIVE, "stop and drop the goal", "abort --id r2", COMMANDS, words="CommandWords"
        ),
        "rtl": Verb(
            DRIVE,
            "drive back along the robot's own trail",
            "rtl",
            COMMANDS,
            words="LeasedCommandWords",
        ),
        "arm": Verb(DRIVE, "arm the motors", "arm", COMMANDS, words="LeasedCommandWords"),
        "disarm": Verb(DRIVE, "disarm the motors", "disarm", COMMANDS, words="CommandWords"),
        "estop": Verb(DRIVE, "emergency stop, latched", "estop --all", COMMANDS, words="StopWords"),
        "clear-estop": Verb(
            DRIVE, "release the emergency stop", "clear-estop --all", COMMANDS, words="ClearWords"
        ),
        "mode": Verb(DRIVE, "choose the mode", "mode auto", COMMANDS, words="ModeWords"),
        "navigator": Verb(
            DRIVE, "choose the navigator", "navigator bug left", COMMANDS, words="NavigatorWords"
        ),
        "teleop": Verb(
            DRIVE,
            "drive by hand at a speed and a turn",
            "teleop 0.2 15 --for 3",
            DRIVING,
            words="TeleopWords",
        ),
        "watch": Verb(
            LOOK, "print telemetry and texts as lines", "watch --once", LOOKING, words="WatchWords"
        ),
        "ps": Verb(
            LOOK,
            "list what `up` runs here: endpoint, robots, world, processes",
            "ps --json",
            "ground.cli.observe.ps",
            run="run",
        ),
        "doctor": Verb(
            LOOK,
            "find problems, and how to fix them",
            "doctor --timeout 5",
            LOOKING,
            words="DoctorWords",
        ),
        "explain": Verb(
            LOOK,
            "show why the robot turns, live or in a recording",
            "explain drive.mcap --at 12.5",
            OF_RECORDINGS,
            words="ExplainWords",
            suffixes=RECORDINGS,
        ),
        "ghost": Verb(
            LOOK,
            "show what another navigator would do from here on",
            "ghost --navigator bug --from drive.mcap",
            "ground.cli.observe.ghost",
            act="act",
            run="run",
            suffixes=RECORDINGS,
        ),
        "replay": Verb(
            LOOK,
            "show a recorded run, or execute it again",
            "replay drive.mcap --speed 2",
            "ground.cli.observe.replay",
            run="run",
            suffixes=RECORDINGS,
        ),
        "share": Verb(
            LOOK,
            "put a recording, its plot and its explanation into one .zip",
            "share drive.mcap --out drive.zip",
            OF_RECORDINGS,
            words="ShareWords",
            suffixes=RECORDINGS,
        ),
        "trial": Verb(
            TEST,
            "run one trial as fast as possible",
            "trial --world u_trap --navigator bug --json",
            "study.cli.trial",
        ),
        "study": Verb(
            TEST,
            "run many trials on all cores, and report the results",
            "study --quick --output results",
            "study.cli.study",
            subcommands=subcommand_table.STUDY,
        ),
        "falsify": Verb(
            TEST,
            "search for worlds in which a navigator fails",
            "falsify vgm_memory --minutes 10 --output findings",
            "study.cli.falsify",
        ),
        "calibrate": Verb(
            TEST,
            "find wheels, track and slip by squares",
            "calibrate --noise harsh --output robot.toml",
            "study.cli.calibrate",
        ),
        "bench": Verb(
            TEST,
            "measure speed and cost",
            "bench latency",
            "benchmarks.__main__",
        ),
        "plant": Verb(
            RUN,
            "the world: pymunk, sonars, wheels, noise",
            "run plant --world box --lockstep --speed 3",
            "plant.process.run",
        ),
        "robot": Verb(
            RUN,
            "the control loop of one robot, 20 Hz",
            "run robot --id r1 --start 0.6 2 0 --lockstep",
            "robot.cli",
            hosts=MappingProxyType({"--mcu": "firmware.host"}),
        ),
        "router": Verb(
            RUN,
            "a Zenoh router for more than one robot or machine",
            "run router --listen tcp/0.0.0.0:7447",
            "ground.cli.run.router",
            run="run",
        ),
        "gateway": Verb(
            RUN,
            "present robots to MAVLink ground stations",
            "run gateway udpin:127.0.0.1:14550",
            "ground.cli.run.gateway",
            run="run",
        ),
        "berth": Verb(
            RUN,
            "run a verb in a container: robot, start and network",
            "run container --robots 2 --replica robot- run robot",
            "ground.cli.run.container",
            name="container",
            run="run",
        ),
        "health": Verb(
            RUN,
            "health check: does a role publish its data?",
            "run health robot --id r1",
            "ground.cli.observe.health",
            act="act",
            run="run",
        ),
        "bridge": Verb(
            RUN,
            "serve live data to Foxglove or Lichtblick",
            "run bridge --at 127.0.0.1:8765",
            "ground.cli.observe.bridge",
            act="act",
        ),
        "record": Verb(
            REC,
            "write every frame to a .tlog and an .mcap file",
            "rec start recordings --keep 2GB",
            "ground.cli.observe.record",
            name="start",
            run="run",
        ),
        "recordings": Verb(
            REC,
            "list the recordings, the newest first",
            "rec list --json",
            OF_RECORDINGS,
            words="ListWords",
            name="list",
        ),
        "mark": Verb(
            REC,
            "add a remark to the recording",
            "rec mark the door is closed now",
            COMMANDS,
            words="MarkWords",
        ),
        "export": Verb(
            REC,
            "convert a recording to a CSV or Parquet table",
            "rec export drive.mcap --out drive.csv",
            OF_RECORDINGS,
            words="ExportWords",
            suffixes=RECORDINGS,
        ),
        "plot": Verb(
            REC,
            "draw a recorded run as a picture",
            "rec plot drive.mcap --out drive.svg",
            OF_RECORDINGS,
            words="PlotWords",
            suffixes=RECORDINGS,
        ),
        "reexecute": Verb(
            REC,
            "execute a recorded run again",
            "rec reexecute drive.mcap --navigator bug",
            "study.cli.reexecute",
            suffixes=RECORDINGS,
        ),
        "param": Verb(
            MORE,
            "read and set the robot's parameters",
            "param set d_obs_m 0.35",
            "ground.grammar.parameters",
            words="ParameterWords",
            subcommands=subcommand_table.PARAM,
        ),
        "mission": Verb(
            MORE,
            "waypoints: check, send, start, pause, jump, fetch, convert",
            "mission upload mission.toml",
            "ground.grammar.missions",
            words="MissionWords",
            suffixes=MISSIONS,
            subcommands=subcommand_table.MISSION,
        ),
        "fence": Verb(
            MORE,
            "keep the robot inside of a circle or polygon",
            "fence circle 3 2 2.5",
            "ground.grammar.fences",
            words="FenceWords",
            subcommands=subcommand_table.FENCE,
        ),
        "pose": Verb(
            MORE,
            "set the pose of a robot that has lost its place",
            "pose set 2 1.5 90",
            "ground.grammar.places",
            words="PoseWords",
            subcommands=subcommand_table.POSE,
        ),
        "lease": Verb(
            MORE,
            "take or give back control of the robot, or show who has it",
            "lease take --for 60",
            COMMANDS,
            words="LeaseWords",
        ),
        "keys": Verb(
            MORE,
            "certificates for a locked bus, and MAVLink signing keys",
            "keys new keys --robots r1 r2",
            "ground.cli.run.certificates",
            run="run",
            subcommands=subcommand_table.KEYS,
        ),
        "mavlink": Verb(
            MORE,
            "test any MAVLink vehicle as a client does",
            "mavlink check udpout:127.0.0.1:14550 --rows 1-18",
            "ground.cli.observe.mavlink",
            run="run",
            subcommands=subcommand_table.MAVLINK,
        ),
        "worlds": Verb(
            MORE,
            "list, check, show, generate and import world files",
            "worlds show u_trap",
            "plant.cli",
            subcommands=subcommand_table.WORLDS,
        ),
        "config": Verb(
            MORE,
            "your settings: theme, rate, keys, contexts, commands at the start",
            "config set theme light",
            "ground.cli.run.settings",
            run="run",
            subcommands=subcommand_table.CONFIG,
        ),
        "completion": Verb(
            MORE,
            "print the completion script of bash, zsh or fish",
            "completion bash",
            "runtime.cli.completion_script",
        ),
    }
)
"""The verbs by their short word, in the order of `sidestep --help`.

The short word is the `verb` of JSON output. For a verb below a group it is an old name, which
`find` accepts too.
"""
