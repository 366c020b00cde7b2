"""Every verb of `sidestep`, described once: its group, its line of help, and the code that does it.

The executable, each verb's own `--help` and the console of the ground station read this table. It
names modules and imports none, so that a process loads only the verb that was asked for.
"""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final, NamedTuple

RUN: Final = "run"
COMMAND: Final = "command"
LOOK: Final = "look"
STUDY: Final = "study"
COMMANDS: Final = "ground.grammar.commands"
DRIVING: Final = "ground.grammar.driving"
LOOKING: Final = "ground.grammar.looking"


class Verb(NamedTuple):
    """A verb as the name of its module and the names of the functions in it.

    `words` is the class that reads a typed operation, for the shell and for the app's command line.
    Other verbs of an operator read `arguments`, and then either run by themselves (`run`), or act
    over a link to a robot (`act`). A verb with none of these is a program: `main` takes its words.
    """

    group: str
    summary: str
    module: str
    act: str = ""
    run: str = ""
    arguments: str = "arguments"
    words: str = ""

    @property
    def is_program(self) -> bool:
        return not (self.act or self.run or self.words)


VERBS: Final[Mapping[str, Verb]] = MappingProxyType(
    {
        "up": Verb(
            RUN,
            "start plant, robot and a goal, and tell how it ended",
            "ground.cli.run.up",
            run="run",
        ),
        "plant": Verb(RUN, "the world: pymunk, sonars, wheels, noise", "plant.cli.plant"),
        "robot": Verb(RUN, "the control loop of one robot, 20 Hz", "robot.cli"),
        "ground": Verb(
            RUN,
            "the ground station, in this terminal or in a browser",
            "ground.cli.run.ground",
            "act_ground",
            "run_ground",
            "ground_arguments",
        ),
        "router": Verb(
            RUN,
            "a Zenoh router for more than one robot or machine",
            "ground.cli.run.router",
            run="run",
        ),
        "keys": Verb(
            RUN,
            "who may join a locked bus: certificates made, and checked",
            "ground.cli.run.certificates",
            run="run",
        ),
        "berth": Verb(
            RUN,
            "a verb in a container: its robot, its start, its network",
            "ground.cli.run.container",
            run="run",
        ),
        "goto": Verb(
            COMMAND, "drive to X Y [DEG] and wait for the outcome", DRIVING, words="GotoWords"
        ),
        "hold": Verb(COMMAND, "stand still, keep the goal", COMMANDS, words="CommandWords"),
        "resume": Verb(COMMAND, "go on to the goal", COMMANDS, words="CommandWords"),
        "abort": Verb(COMMAND, "drop the goal and stand still", COMMANDS, words="CommandWords"),
        "rtl": Verb(
            COMMAND, "drive back along the robot's own trail", COMMANDS, words="CommandWords"
        ),
        "arm": Verb(COMMAND, "let the wheels turn", COMMANDS, words="CommandWords"),
        "disarm": Verb(COMMAND, "do not let the wheels turn", COMMANDS, words="CommandWords"),
        "estop": Verb(COMMAND, "emergency stop, latched", COMMANDS, words="StopWords"),
        "clear-estop": Verb(COMMAND, "release the emergency stop", COMMANDS, words="CommandWords"),
        "mode": Verb(COMMAND, "choose the mode", COMMANDS, words="ModeWords"),
        "navigator": Verb(COMMAND, "choose the navigator", COMMANDS, words="NavigatorWords"),
        "param": Verb(
            COMMAND,
            "read and set the robot's parameters",
            "ground.grammar.parameters",
            words="ParameterWords",
        ),
        "mission": Verb(
            COMMAND,
            "waypoints: check, send, start, pause, jump, fetch, convert",
            "ground.grammar.missions",
            words="MissionWords",
        ),
        "fence": Verb(
            COMMAND,
            "keep the robot inside of a circle or polygon",
            "ground.grammar.fences",
            words="FenceWords",
        ),
        "lease": Verb(
            COMMAND,
            "who commands the robot: take it, give it back, show it",
            COMMANDS,
            words="LeaseWords",
        ),
        "teleop": Verb(
            COMMAND, "drive by hand at a speed and a turn", DRIVING, words="TeleopWords"
        ),
        "watch": Verb(LOOK, "show what the robot says, line by line", LOOKING, words="WatchWords"),
        "doctor": Verb(LOOK, "say what is missing and what to do", LOOKING, words="DoctorWords"),
        "health": Verb(
            LOOK,
            "are the data of a role flowing? For health checks",
            "ground.cli.observe.health",
            "act",
            "run",
        ),
        "explain": Verb(
            LOOK, "why did it turn? now, or in a recording", LOOKING, words="ExplainWords"
        ),
        "ghost": Verb(
            LOOK,
            "what another navigator would do from here on",
            "ground.cli.observe.ghost",
            "act",
            "run",
        ),
        "record": Verb(
            LOOK,
            "write every frame to a .tlog and an .mcap file",
            "ground.cli.observe.record",
            run="run",
        ),
        "bridge": Verb(
            LOOK,
            "live, for Foxglove or Lichtblick to connect to",
            "ground.cli.observe.bridge",
            "act",
        ),
        "mark": Verb(LOOK, "a remark in what is being recorded", COMMANDS, words="MarkWords"),
        "replay": Verb(
            LOOK, "a recorded run, shown or executed again", "ground.cli.observe.replay", run="run"
        ),
        "export": Verb(
            LOOK, "a recording as a table: CSV or Parquet", LOOKING, words="ExportWords"
        ),
        "plot": Verb(LOOK, "a recorded run as a picture", LOOKING, words="PlotWords"),
        "reexecute": Verb(STUDY, "what `replay --re-execute` does", "study.cli.reexecute"),
        "trial": Verb(STUDY, "one run in this process, as fast as possible", "study.cli.trial"),
        "study": Verb(
            STUDY, "many trials on all cores, their results and a report", "study.cli.study"
        ),
        "calibrate": Verb(STUDY, "wheels, track and slip from squares", "study.calibration.cli"),
        "worlds": Verb(
            STUDY, "list, check, show, generate and import world files", "plant.cli.worlds"
        ),
        "bench": Verb(STUDY, "measure, against floors and peers", "benchmarks.__main__"),
    }
)
"""In the order of `sidestep --help`."""
