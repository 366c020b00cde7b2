"""The rows of the verb table for subcommands: summary and example of each."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final, NamedTuple


class Subcommand(NamedTuple):
    """A subcommand of a verb.

    `example` is a command line without `sidestep`. `module` is given if the subcommand is a program
    with a `parser` of its own.
    """

    summary: str
    example: str
    module: str = ""


MISSION: Final[Mapping[str, Subcommand]] = MappingProxyType(
    {
        "check": Subcommand("report the faults of a mission file", "mission check mission.toml"),
        "upload": Subcommand(
            "send a mission and its fence, if any, to the robot",
            "mission upload mission.toml",
        ),
        "download": Subcommand(
            "write the robot's mission to a file", "mission download fetched.plan"
        ),
        "list": Subcommand("show the items of the robot's mission", "mission list --json"),
        "start": Subcommand("drive the mission, from an item on", "mission start 2"),
        "pause": Subcommand("stop, and keep the mission", "mission pause"),
        "resume": Subcommand("continue the mission", "mission resume"),
        "abort": Subcommand("cancel the mission and stop", "mission abort --id r2"),
        "jump": Subcommand("continue with another item", "mission jump 3"),
        "status": Subcommand("show the progress of the mission", "mission status --json"),
        "clear": Subcommand("delete the mission from the robot", "mission clear --id r2"),
        "convert": Subcommand(
            "convert between formats of mission files, chosen by the suffixes",
            "mission convert mission.toml mission.plan",
        ),
    }
)
FENCE: Final[Mapping[str, Subcommand]] = MappingProxyType(
    {
        "circle": Subcommand("stay within R metres of X Y", "fence circle 3 2 2.5"),
        "polygon": Subcommand("stay inside these corners", "fence polygon 0 0 6 0 6 4 0 4"),
        "off": Subcommand("remove the fence", "fence off"),
        "show": Subcommand("show the robot's fence", "fence show --json"),
    }
)
POSE: Final[Mapping[str, Subcommand]] = MappingProxyType(
    {
        "set": Subcommand("set the pose of the robot to X Y [DEG]", "pose set 2 1.5 90"),
        "truth": Subcommand("set the pose of a simulated robot to the true one", "pose truth"),
    }
)
PARAM: Final[Mapping[str, Subcommand]] = MappingProxyType(
    {
        "list": Subcommand("all parameters, with unit, range, default and meaning", "param list"),
        "get": Subcommand("parameters whose name matches, as in 'sonar_*'", "param get 'sonar_*'"),
        "diff": Subcommand("parameters that differ from their defaults", "param diff --json"),
        "set": Subcommand(
            "set one parameter; a robot with --state saves it", "param set d_obs_m 0.35"
        ),
        "reset": Subcommand("set one parameter to its default value", "param reset d_obs_m"),
        "save": Subcommand("write the changed parameters to a file", "param save tuned.toml"),
        "load": Subcommand("set all values of a file, if all are allowed", "param load tuned.toml"),
    }
)
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
STUDY: Final[Mapping[str, Subcommand]] = MappingProxyType(
    {
        "report": Subcommand(
            "write the report of a study again", "study report results", "study.cli.report"
        ),
    }
)
