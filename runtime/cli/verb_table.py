"""The table of all verbs of `sidestep`: group, summary and implementation of each.

The executable, the verbs' `--help` and the console of the ground station read this table. It names
modules and imports none, so that a process loads only the verb it runs.
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
    """A verb, with the names of its module and of the functions in it.

    `words` is the class that parses a typed operation, for the shell and for the app's command
    line. Other verbs of an operator parse `arguments` and then either run by themselves (`run`) or
    act over a link to a robot (`act`). A verb with none of these is a program with a `main`.
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
        """True for a verb whose module has its own `main`."""
        return not (self.act or self.run or self.words)


VERBS: Final[Mapping[str, Verb]] = MappingProxyType(
    {
        "up": Verb(
            RUN,
            "start plant and robot, drive to a goal, report the outcome",
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
            "certificates for a locked bus: create and check them",
            "ground.cli.run.certificates",
            run="run",
        ),
        "berth": Verb(
            RUN,
            "run a verb in a container: robot, start and network",
            "ground.cli.run.container",
            run="run",
        ),
        "goto": Verb(
            COMMAND, "drive to X Y [DEG] and wait for the outcome", DRIVING, words="GotoWords"
        ),
        "hold": Verb(COMMAND, "stop and keep the goal", COMMANDS, words="CommandWords"),
        "resume": Verb(COMMAND, "continue to the goal", COMMANDS, words="CommandWords"),
        "abort": Verb(COMMAND, "stop and drop the goal", COMMANDS, words="CommandWords"),
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
            "exclusive command of the robot: take, release, show",
            COMMANDS,
            words="LeaseWords",
        ),
        "teleop": Verb(
            COMMAND, "drive by hand at a speed and a turn", DRIVING, words="TeleopWords"
        ),
        "watch": Verb(LOOK, "print telemetry and texts as lines", LOOKING, words="WatchWords"),
        "doctor": Verb(LOOK, "find problems, and how to fix them", LOOKING, words="DoctorWords"),
        "health": Verb(
            LOOK,
            "health check: does a role publish its data?",
            "ground.cli.observe.health",
            "act",
            "run",
        ),
        "explain": Verb(
            LOOK, "show why the robot turns, live or in a recording", LOOKING, words="ExplainWords"
        ),
        "ghost": Verb(
            LOOK,
            "show what another navigator would do from here on",
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
            "serve live data to Foxglove or Lichtblick",
            "ground.cli.observe.bridge",
            "act",
        ),
        "mark": Verb(LOOK, "add a remark to the recording", COMMANDS, words="MarkWords"),
        "replay": Verb(
            LOOK, "show a recorded run, or execute it again", "ground.cli.observe.replay", run="run"
        ),
        "export": Verb(
            LOOK, "convert a recording to a CSV or Parquet table", LOOKING, words="ExportWords"
        ),
        "plot": Verb(LOOK, "draw a recorded run as a picture", LOOKING, words="PlotWords"),
        "reexecute": Verb(STUDY, "execute a recorded run again", "study.cli.reexecute"),
        "trial": Verb(STUDY, "run one trial as fast as possible", "study.cli.trial"),
        "study": Verb(
            STUDY, "run many trials on all cores, and report the results", "study.cli.study"
        ),
        "calibrate": Verb(STUDY, "find wheels, track and slip by squares", "study.calibration.cli"),
        "worlds": Verb(
            STUDY, "list, check, show, generate and import world files", "plant.cli.worlds"
        ),
        "bench": Verb(STUDY, "measure speed and cost", "benchmarks.__main__"),
    }
)
"""In the order of `sidestep --help`."""
