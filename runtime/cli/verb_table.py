"""The table of all verbs of `sidestep` and their subcommands, and how a typed line finds its verb.

The executable, the parsers, `--help`, shell completion, the reference and the app's command line
read this table. It names modules and imports none, so that a process loads only the verb it runs.
"""

from collections.abc import Iterable, Mapping, Sequence
from types import MappingProxyType
from typing import Final, NamedTuple

from runtime.cli.command_index import COMMANDS as LISTED
from runtime.cli.verb import DRIVE, GROUPS, LOOK, MORE, REC, RUN, SECTIONS, TEST, Subcommand, Verb

KEYS: Final[Mapping[str, Subcommand]] = MappingProxyType(
    {
        "new": Subcommand(
            "an authority, and certificate, key and config per role", "keys new keys --robots r1 r2"
        ),
        "renew": Subcommand(
            "new certificates and keys from a kept authority", "keys renew keys robot-r2 --days 90"
        ),
        "revoke": Subcommand(
            "reject a certificate although it is valid", "keys revoke keys ground-ada"
        ),
        "check": Subcommand("expiry and faults of each certificate", "keys check keys"),
        "stops": Subcommand("add stop secrets to keys of an older version", "keys stops keys"),
        "signing": Subcommand(
            "signing keys of the MAVLink gateway: new, show, rotate, retire", "keys signing new"
        ),
    }
)
CONFIG: Final[Mapping[str, Subcommand]] = MappingProxyType(
    {
        "get": Subcommand("print one setting, or all of them", "config get theme"),
        "set": Subcommand("change a setting, if its value is valid", "config set theme light"),
        "path": Subcommand("print the path of the settings", "config path"),
        "context": Subcommand("list the contexts, or use one from now on", "config context lab"),
    }
)
MAVLINK: Final[Mapping[str, Subcommand]] = MappingProxyType(
    {
        "check": Subcommand(
            "test a MAVLink vehicle against the requirements of clients",
            "mavlink check udpout:127.0.0.1:14550",
        ),
        "watch": Subcommand(
            "show a MAVLink vehicle in the terminal, without commanding it",
            "mavlink watch udpout:127.0.0.1:14550",
        ),
        "compare": Subcommand(
            "compare two reports of `mavlink check --json`",
            "mavlink compare before.json after.json",
        ),
    }
)
ROS2: Final[Mapping[str, Subcommand]] = MappingProxyType(
    {
        "check": Subcommand(
            "judge what the robots on a ROS 2 network offer, and how fresh it is",
            "ros2 check --namespace r1",
        ),
    }
)
WORLDS: Final[Mapping[str, Subcommand]] = MappingProxyType(
    {
        "list": Subcommand("list the shipped worlds", "worlds list"),
        "faults": Subcommand(
            "list the faults for the [[fault]] tables of a world", "worlds faults --json"
        ),
        "check": Subcommand(
            "check a world file; print line, key, reason and fix of each problem",
            "worlds check yard.toml",
        ),
        "show": Subcommand("draw a world, or print it as JSON", "worlds show u_trap"),
        "generate": Subcommand(
            "make world files of the corpus; equal family, number and seed give an equal world",
            "worlds generate --family maze --per-family 3 --out made",
        ),
        "import": Subcommand(
            "make world files from a file of another format",
            "worlds import lab.yaml --start 1 1 --goal 8 3 --out made",
        ),
    }
)
NAVIGATORS: Final[Mapping[str, Subcommand]] = MappingProxyType(
    {
        "list": Subcommand("list the robot's navigators", "navigators list"),
        "new": Subcommand("write a file to begin with", "navigators new my_nav"),
        "check": Subcommand("load a file; say what is wrong in it", "navigators check my_nav.py"),
    }
)
STUDY: Final[Mapping[str, Subcommand]] = MappingProxyType(
    {
        "report": Subcommand(
            "write the report of a study again", "study report results", "study.cli.report"
        ),
    }
)


RECORDINGS: Final = (".tlog", ".mcap")


PROGRAMS: Final[Mapping[str, Verb]] = MappingProxyType(
    {
        "up": Verb(
            DRIVE,
            "start plant and robot, drive to a goal, report the outcome",
            "up --world box --navigator bug",
            "ground.cli.run.up",
            run="run",
            rank=10,
            elsewhere="it starts its own robot: run it in another terminal",
        ),
        "tutorial": Verb(
            DRIVE,
            "the first ten minutes: a drive with a guide on the screen",
            "tutorial",
            "ground.cli.run.tutorial",
            run="run",
            rank=20,
        ),
        "ground": Verb(
            DRIVE,
            "the ground station, in this terminal or in a browser",
            "ground --web 8765 --no-record",
            "ground.cli.run.ground",
            run="run_ground",
            arguments="ground_arguments",
            rank=30,
            elsewhere="the ground station is running already",
        ),
        "ps": Verb(
            LOOK,
            "list what `up` runs here: endpoint, robots, world, processes",
            "ps --json",
            "ground.cli.observe.ps",
            run="run",
            rank=20,
        ),
        "ghost": Verb(
            LOOK,
            "show what another navigator would do from here on",
            "ghost --navigator bug --from drive.mcap",
            "ground.cli.observe.ghost",
            run="run",
            suffixes=RECORDINGS,
            rank=50,
        ),
        "replay": Verb(
            LOOK,
            "show a recorded run, or execute it again",
            "replay drive.mcap --speed 2",
            "ground.cli.observe.replay",
            run="run",
            suffixes=RECORDINGS,
            rank=60,
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
            subcommands=STUDY,
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
            "checks.__main__",
        ),
        "plant": Verb(
            RUN,
            "the world: pymunk, sonars, wheels, noise",
            "run plant --world box --lockstep --speed 3",
            "plant.process",
        ),
        "robot": Verb(
            RUN,
            "the control loop of one robot, 20 Hz",
            "run robot --id r1 --start 0.6 2 0 --lockstep",
            "robot.run",
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
            "gateways.mavlink.gateway_verb",
            run="run",
        ),
        "berth": Verb(
            RUN,
            "run a verb in a container: robot, start and network",
            "run container --robots 2 --replica robot- run robot",
            "ground.cli.run.container",
            name="container",
            run="run",
            elsewhere="it is for processes in a container",
        ),
        "health": Verb(
            RUN,
            "health check: does a role publish its data?",
            "run health robot --id r1",
            "ground.cli.observe.health",
            run="run",
            elsewhere="it is for health checks of containers: doctor reports more",
        ),
        "bridge": Verb(
            RUN,
            "serve live data to Foxglove or Lichtblick",
            "run bridge --at 127.0.0.1:8765",
            "gateways.foxglove_bridge",
            run="run",
        ),
        "rosnode": Verb(
            RUN,
            "present robots as nodes to ROS 2, over Zenoh",
            "run ros2 --robots r1,r2",
            "gateways.ros2.ros2_verb",
            name="ros2",
            run="run",
        ),
        "record": Verb(
            REC,
            "write every frame to a .tlog and an .mcap file",
            "rec start recordings --keep 2GB",
            "ground.cli.observe.record",
            name="start",
            run="run",
            rank=10,
        ),
        "reexecute": Verb(
            REC,
            "execute a recorded run again",
            "rec reexecute drive.mcap --navigator bug",
            "study.cli.reexecute",
            suffixes=RECORDINGS,
            rank=60,
        ),
        "keys": Verb(
            MORE,
            "certificates for a locked bus, and MAVLink signing keys",
            "keys new keys --robots r1 r2",
            "ground.cli.run.certificates",
            run="run",
            subcommands=KEYS,
            rank=60,
        ),
        "mavlink": Verb(
            MORE,
            "test any MAVLink vehicle as a client does",
            "mavlink check udpout:127.0.0.1:14550 --rows 1-18",
            "ground.cli.observe.mavlink",
            run="run",
            subcommands=MAVLINK,
            rank=70,
        ),
        "ros2": Verb(
            MORE,
            "test any robot of ROS 2 as its tools see it",
            "ros2 check --namespace r1",
            "gateways.ros2.check_verb",
            run="run",
            subcommands=ROS2,
            rank=75,
        ),
        "worlds": Verb(
            MORE,
            "list, check, show, generate and import world files",
            "worlds show u_trap",
            "plant.cli",
            subcommands=WORLDS,
            rank=80,
        ),
        "navigators": Verb(
            MORE,
            "list the navigators; begin and check one of your own",
            "navigators new my_nav",
            "study.cli.navigators",
            subcommands=NAVIGATORS,
            rank=85,
        ),
        "config": Verb(
            MORE,
            "your settings: theme, rate, keys, contexts, commands at the start",
            "config set theme light",
            "ground.cli.run.settings",
            run="run",
            subcommands=CONFIG,
            rank=90,
        ),
        "completion": Verb(
            MORE,
            "print the completion script of bash, zsh or fish",
            "completion bash",
            "runtime.cli.completion",
            rank=100,
        ),
    }
)
VERBS: Final[Mapping[str, Verb]] = MappingProxyType(
    dict(
        sorted(
            {**PROGRAMS, **LISTED}.items(),
            key=lambda row: (SECTIONS.index(row[1].section), row[1].rank),
        )
    )
)
"""The verbs by their short word, in the order of `sidestep --help`.

The short word is the `verb` of JSON output. For a verb below a group it is an old name, which
`find` accepts too.
"""


def command_of(word: str) -> str:
    """Return how a verb is typed after `sidestep`, such as `rec plot` for `plot`."""
    verb = VERBS[word]
    return f"{verb.section} {verb.name or word}" if verb.is_grouped else word


WORDS: Final[Mapping[tuple[str, ...], str]] = MappingProxyType(
    {tuple(command_of(word).split()): word for word in VERBS}
)


class Call(NamedTuple):
    """A verb with its arguments; `is_old` for a name from before the verb had a group."""

    word: str
    arguments: list[str]
    is_old: bool = False


def find(words: Sequence[str]) -> Call | None:
    """Return the verb that a command line begins with, by its present or its old name."""
    for length in (2, 1):
        if word := WORDS.get(tuple(words[:length])):
            return Call(word, list(words[length:]))
    if words and words[0] in VERBS:
        return Call(words[0], list(words[1:]), is_old=True)
    return None


WORDS_OF_OTHERS: Final[Mapping[str, str]] = MappingProxyType({"status": "watch"})
"""Verbs of other programs, and what they are here."""


def nearest_verb(words: Sequence[str]) -> str:
    """Return a suggestion for words that are no verb, or ""."""
    commands = {word: command_of(word) for word in VERBS}
    if words[0] not in GROUPS:
        last_words = {command.split()[-1]: command for command in commands.values()}
        known = last_words | commands | {group: group for group in GROUPS}
        return nearest(words[0], {**known, **WORDS_OF_OTHERS})
    if words[1] in VERBS:
        return nearest(words[1], commands)
    below = [command for command in commands.values() if command.startswith(f"{words[0]} ")]
    return nearest(" ".join(words[:2]), below)


def nearest(word: str, known: Iterable[str]) -> str:
    """Return a suggestion for a misspelt word: the nearest one, or what a mapping has for it."""
    from difflib import get_close_matches  # needed only after a mistake

    names = known if isinstance(known, Mapping) else {name: name for name in known}
    near = get_close_matches(word, names, n=1)
    return f"; did you mean {names[near[0]]!r}?" if near else ""


def with_present_name(words: Sequence[str]) -> list[str]:
    """Return a command line whose verb has its present name; words without a verb as they are."""
    call = find(words)
    return list(words) if call is None else [*command_of(call.word).split(), *call.arguments]
