"""Sidestep: the command line, and the Python API.

As the executable it is a table from verb to the package that does the work, imported only when
asked. `import sidestep` gives the names of `ground.client.public`, each imported at its first use:

    async with sidestep.connect() as robot:
        outcome = await robot.goto(5.4, 2.0)
"""

import importlib
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from ground.client.public import *  # noqa: F403

ROOT = Path(__file__).resolve().parent
EXIT_USAGE = 2
EXIT_INTERRUPTED = 130
EXIT_BROKEN_PIPE = 141


class Verb(NamedTuple):
    """`module.main(arguments)` does it; a module that does several verbs is told which."""

    module: str
    says: str
    tells_verb: bool = True


GROUND = "ground.cli.main"

GROUPS: dict[str, dict[str, Verb]] = {
    "run": {
        "up": Verb(GROUND, "start plant, robot and a goal, and tell how it ended"),
        "plant": Verb("plant.cli.plant", "the world: pymunk, sonars, wheels, noise", False),
        "robot": Verb("robot.cli", "the control loop of one robot, 20 Hz", False),
        "ground": Verb(GROUND, "the ground station, in this terminal or in a browser"),
        "router": Verb(GROUND, "a Zenoh router for more than one robot or machine"),
        "keys": Verb(GROUND, "who may join a locked bus: certificates made, and checked"),
        "berth": Verb(GROUND, "a verb in a container: its robot, its start, its network"),
    },
    "command": {
        "goto": Verb(GROUND, "drive to X Y [DEG] and wait for the outcome"),
        "hold": Verb(GROUND, "stand still, keep the goal"),
        "resume": Verb(GROUND, "go on to the goal"),
        "abort": Verb(GROUND, "drop the goal and stand still"),
        "rtl": Verb(GROUND, "drive back along the robot's own trail"),
        "arm": Verb(GROUND, "let the wheels turn"),
        "disarm": Verb(GROUND, "do not let the wheels turn"),
        "estop": Verb(GROUND, "emergency stop, latched"),
        "clear-estop": Verb(GROUND, "release the emergency stop"),
        "mode": Verb(GROUND, "choose the mode"),
        "navigator": Verb(GROUND, "choose the navigator"),
        "param": Verb(GROUND, "read and set the robot's parameters"),
        "mission": Verb(GROUND, "waypoints: check, send, start, pause, jump, fetch, convert"),
        "fence": Verb(GROUND, "keep the robot inside of a circle or polygon"),
        "lease": Verb(GROUND, "who commands the robot: take it, give it back, show it"),
        "teleop": Verb(GROUND, "drive by hand at a speed and a turn"),
    },
    "look": {
        "watch": Verb(GROUND, "show what the robot says, line by line"),
        "doctor": Verb(GROUND, "say what is missing and what to do"),
        "health": Verb(GROUND, "are the data of a role flowing? For health checks"),
        "explain": Verb(GROUND, "why did it turn? now, or in a recording"),
        "ghost": Verb(GROUND, "what another navigator would do from here on"),
        "record": Verb(GROUND, "write every frame to a .tlog and an .mcap file"),
        "bridge": Verb(GROUND, "live, for Foxglove or Lichtblick to connect to"),
        "mark": Verb(GROUND, "a remark in what is being recorded"),
        "replay": Verb(GROUND, "a recorded run, shown or executed again"),
        "export": Verb(GROUND, "a recording as a table: CSV or Parquet"),
        "plot": Verb(GROUND, "a recorded run as a picture"),
    },
    "study": {
        "reexecute": Verb("study.cli.reexecute", "what `replay --re-execute` does"),
        "trial": Verb("study.cli.trial", "one run in this process, as fast as possible"),
        "study": Verb("study.cli.study", "many trials on all cores, their results and a report"),
        "calibrate": Verb("study.calibration.cli", "wheels, track and slip from squares", False),
        "worlds": Verb(
            "plant.cli.worlds", "list, check, show, generate and import world files", False
        ),
        "bench": Verb("benchmarks.__main__", "measure, against floors and peers", False),
    },
}
VERBS = {name: verb for group in GROUPS.values() for name, verb in group.items()}

USAGE = "usage: sidestep [--traceback] VERB ...\n       sidestep --help | --version"


def main(argv: Sequence[str] | None = None) -> int:
    """Run one verb; 0 reached or done, 1 not reached or refused, 2 wrong usage or configuration."""
    from runtime.terminal import guarded_output  # the table alone imports nothing of ours

    try:
        with guarded_output():
            code = dispatch(list(sys.argv[1:] if argv is None else argv))
            sys.stdout.flush()
    except KeyboardInterrupt:
        return EXIT_INTERRUPTED
    except BrokenPipeError:
        return reader_gone()
    return code


def dispatch(arguments: list[str]) -> int:
    wants_traceback = arguments[:1] == ["--traceback"]
    if wants_traceback:
        del arguments[0]
    if not arguments:
        return complain("which verb?")
    word, *rest = arguments
    if word in ("-h", "--help", "help"):
        print(overview())
        return 0
    if word == "--version":
        print(f"sidestep {version()}")
        return 0
    if word not in VERBS:
        return complain(f"no such verb: {word!r}{nearest(word)}")
    try:
        return call(VERBS[word], word, rest)
    except (BrokenPipeError, KeyboardInterrupt):
        raise
    except Exception as error:
        if wants_traceback:
            raise
        return explain(word, error)


def call(verb: Verb, word: str, rest: Sequence[str]) -> int:
    package = verb.module.partition(".")[0]
    if not (ROOT / package).is_dir():
        print(
            f"sidestep {word}: needs a checkout of the source, as {package}/ is not installed: "
            f"run `make setup` there, then .venv/bin/sidestep {word}",
            file=sys.stderr,
        )
        return EXIT_USAGE
    entry = importlib.import_module(verb.module).main
    code: int = entry([word, *rest] if verb.tells_verb else list(rest))
    return code


def explain(word: str, error: Exception) -> int:
    """An error meant for the user is its own line; any other is a defect and says where it is."""
    code = getattr(error, "exit_code", None)
    if isinstance(code, int):
        print(f"sidestep {word}: {error}", file=sys.stderr)
        return code
    print(
        f"sidestep {word}: internal error: {type(error).__name__}: {error}{place_of(error)}\n"
        f"for the whole story: sidestep --traceback {word} ...",
        file=sys.stderr,
    )
    return 1


def place_of(error: Exception) -> str:
    """The innermost line of a file that was running."""
    place, innermost = error.__traceback__, ""
    while place is not None:
        path = place.tb_frame.f_code.co_filename
        if not path.startswith("<"):
            innermost = f" ({path}:{place.tb_lineno})"
        place = place.tb_next
    return innermost


def reader_gone() -> int:
    """Nobody reads our output any more: be silent, as other tools are, also at interpreter exit."""
    import os  # needed only when something went wrong

    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
    return EXIT_BROKEN_PIPE


def complain(message: str) -> int:
    print(f"sidestep: {message}\n{USAGE}", file=sys.stderr)
    return EXIT_USAGE


def nearest(word: str) -> str:
    import difflib  # needed only after a mistake

    near = difflib.get_close_matches(word, VERBS, n=1)
    return f"; did you mean {near[0]!r}?" if near else ""


def overview() -> str:
    lines = ["Sidestep: a robot with eight sonars that finds its way around obstacles.", "", USAGE]
    for group, verbs in GROUPS.items():
        lines += ["", f"{group}:"]
        lines += [f"  {name:<12} {verb.says}" for name, verb in verbs.items()]
    lines += ["", "sidestep VERB --help says more. Exit codes: 0 reached or done, 1 not, 2 usage."]
    return "\n".join(lines)


def version() -> str:
    from importlib import metadata  # slow to import, seldom asked

    try:
        return metadata.version("sidestep")
    except metadata.PackageNotFoundError:
        return "(not installed: make setup)"


def __getattr__(name: str) -> object:
    """Find a name of the API."""
    if not name.startswith("_"):
        public = importlib.import_module("ground.client.public")
        if name in public.__all__:
            return getattr(public, name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    public = importlib.import_module("ground.client.public")
    return sorted({*globals(), *public.__all__})


if __name__ == "__main__":
    sys.exit(main())
