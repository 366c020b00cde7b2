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
SIMPLE: Final = "ground.cli.command.simple_commands"


class Verb(NamedTuple):
    """A verb as the name of its module and the names of the functions in it.

    A verb of an operator reads `arguments`, and then either runs by itself (`run`), or acts over a
    link to a robot that is there already (`act`); one with both checks its arguments before it
    opens a link. A verb with neither is a program of its own: `main` takes its words.
    """

    group: str
    summary: str
    module: str
    act: str = ""
    run: str = ""
    arguments: str = "arguments"

    @property
    def is_program(self) -> bool:
        return not (self.act or self.run)


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
            "ground.cli.look.watch",
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
            COMMAND,
            "drive to X Y [DEG] and wait for the outcome",
            "ground.cli.command.goto",
            "act",
            "run",
        ),
        "hold": Verb(COMMAND, "stand still, keep the goal", SIMPLE, "act"),
        "resume": Verb(COMMAND, "go on to the goal", SIMPLE, "act"),
        "abort": Verb(COMMAND, "drop the goal and stand still", SIMPLE, "act"),
        "rtl": Verb(COMMAND, "drive back along the robot's own trail", SIMPLE, "act"),
        "arm": Verb(COMMAND, "let the wheels turn", SIMPLE, "act"),
        "disarm": Verb(COMMAND, "do not let the wheels turn", SIMPLE, "act"),
        "estop": Verb(
            COMMAND, "emergency stop, latched", SIMPLE, "act_estop", arguments="estop_arguments"
        ),
        "clear-estop": Verb(COMMAND, "release the emergency stop", SIMPLE, "act"),
        "mode": Verb(COMMAND, "choose the mode", SIMPLE, "act_mode", arguments="mode_arguments"),
        "navigator": Verb(
            COMMAND,
            "choose the navigator",
            SIMPLE,
            "act_navigator",
            arguments="navigator_arguments",
        ),
        "param": Verb(
            COMMAND, "read and set the robot's parameters", "ground.cli.command.param", "act"
        ),
        "mission": Verb(
            COMMAND,
            "waypoints: check, send, start, pause, jump, fetch, convert",
            "ground.cli.command.mission",
            "act",
            "run",
        ),
        "fence": Verb(
            COMMAND,
            "keep the robot inside of a circle or polygon",
            "ground.cli.command.fence",
            "act",
            "run",
        ),
        "lease": Verb(
            COMMAND,
            "who commands the robot: take it, give it back, show it",
            "ground.cli.command.lease",
            "act",
        ),
        "teleop": Verb(
            COMMAND,
            "drive by hand at a speed and a turn",
            "ground.cli.command.teleop",
            "act",
            "run",
        ),
        "watch": Verb(
            LOOK, "show what the robot says, line by line", "ground.cli.look.watch", "act"
        ),
        "doctor": Verb(
            LOOK, "say what is missing and what to do", "ground.cli.look.doctor", "act", "run"
        ),
        "health": Verb(
            LOOK,
            "are the data of a role flowing? For health checks",
            "ground.cli.look.health",
            "act",
            "run",
        ),
        "explain": Verb(
            LOOK,
            "why did it turn? now, or in a recording",
            "ground.cli.look.explain",
            "act",
            "run",
        ),
        "ghost": Verb(
            LOOK,
            "what another navigator would do from here on",
            "ground.cli.look.ghost",
            "act",
            "run",
        ),
        "record": Verb(
            LOOK,
            "write every frame to a .tlog and an .mcap file",
            "ground.cli.look.record",
            run="run",
        ),
        "bridge": Verb(
            LOOK, "live, for Foxglove or Lichtblick to connect to", "ground.cli.look.bridge", "act"
        ),
        "mark": Verb(
            LOOK,
            "a remark in what is being recorded",
            "ground.cli.look.record",
            "act_mark",
            arguments="mark_arguments",
        ),
        "replay": Verb(
            LOOK, "a recorded run, shown or executed again", "ground.cli.look.replay", run="run"
        ),
        "export": Verb(
            LOOK, "a recording as a table: CSV or Parquet", "ground.cli.look.export", run="run"
        ),
        "plot": Verb(LOOK, "a recorded run as a picture", "ground.cli.look.plot", run="run"),
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
