"""Sidestep: the command line, and the Python API.

As the executable it looks a verb up in `runtime.cli.verb_table` and imports the package that does
the work only when asked. `import sidestep` gives the names of `ground.client.api`, each imported
at its first use:

    async with sidestep.connect() as robot:
        outcome = await robot.goto(5.4, 2.0)
"""

import importlib
import importlib.util
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ground.client.api import *  # noqa: F403
    from runtime.cli.verb_table import Verb

ROOT = Path(__file__).resolve().parent
EXIT_USAGE = 2
EXIT_INTERRUPTED = 130
EXIT_BROKEN_PIPE = 141
OPERATOR = "ground.cli.main"

USAGE = "usage: sidestep [--traceback] VERB ...\n       sidestep --help | --version"


def main(argv: Sequence[str] | None = None) -> int:
    """Run one verb; 0 reached or done, 1 not reached or refused, 2 wrong usage or configuration."""
    if conflict := displaced("runtime", "protocol"):
        return refuse("", conflict)
    try:
        from runtime.cli.terminal import guarded_output  # the API alone imports nothing of ours
    except Exception:  # of another package nothing is known
        if conflict := shadowing_package():
            return refuse("", conflict)
        raise

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
    verbs = verb_table()
    if word not in verbs:
        return complain(f"no such verb: {word!r}{nearest(word, verbs)}")
    try:
        return call(verbs[word], word, rest)
    except (BrokenPipeError, KeyboardInterrupt):
        raise
    except Exception as error:
        if wants_traceback:
            raise
        return explain(word, error)


def verb_table() -> "Mapping[str, Verb]":
    from runtime.cli.verb_table import VERBS

    return VERBS


def call(verb: "Verb", word: str, rest: Sequence[str]) -> int:
    package = verb.module.partition(".")[0]
    if not (ROOT / package).is_dir():
        return refuse(
            word,
            f"needs a checkout of the source, as {package}/ is not installed: run `make setup` "
            f"there, then .venv/bin/sidestep {word}",
        )
    if conflict := displaced(package):
        return refuse(word, conflict)
    if verb.is_program:
        module, arguments = verb.module, list(rest)
    else:
        module, arguments = OPERATOR, [word, *rest]
    code: int = importlib.import_module(module).main(arguments)
    return code


def own(name: str) -> ModuleType:
    """Load a module of `runtime.cli` by its file: `import runtime` may give another package."""
    full = f"runtime.cli.{name}"
    if full not in sys.modules:
        place = ROOT.joinpath(*full.split(".")).with_suffix(".py")
        spec = importlib.util.spec_from_file_location(full, place)
        assert spec is not None
        assert spec.loader is not None
        sys.modules[full] = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(sys.modules[full])
    return sys.modules[full]


def displaced(*packages: str) -> str:
    """Name the first of these packages of which Python finds another one; empty when none is."""
    return str(next(own("packages").displaced(packages), ""))


def shadowing_package() -> str:
    """Name the package of others that keeps ours from working; empty when there is none."""
    return next((str(found) for found in own("conflicts").conflicts() if found.wins), "")


def refuse(word: str, why: str) -> int:
    print(f"{' '.join(['sidestep', *word.split()])}: {why}", file=sys.stderr)
    return EXIT_USAGE


def explain(word: str, error: Exception) -> int:
    """An error meant for the user is its own line; any other is a defect and says where it is."""
    code = getattr(error, "exit_code", None)
    if isinstance(code, int):
        print(f"sidestep {word}: {error}", file=sys.stderr)
        return code
    if conflict := shadowing_package():
        return refuse(word, conflict)
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


def nearest(word: str, verbs: "Mapping[str, Verb]") -> str:
    import difflib  # needed only after a mistake

    near = difflib.get_close_matches(word, verbs, n=1)
    return f"; did you mean {near[0]!r}?" if near else ""


def overview() -> str:
    lines = ["Sidestep: a robot with eight sonars that finds its way around obstacles.", "", USAGE]
    group = ""
    for word, verb in verb_table().items():
        if verb.group != group:
            group = verb.group
            lines += ["", f"{group}:"]
        lines.append(f"  {word:<12} {verb.summary}")
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
        public = public_names()
        if name in public.__all__:
            return getattr(public, name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *public_names().__all__})


def public_names() -> ModuleType:
    try:
        return importlib.import_module("ground.client.api")
    except Exception as error:  # of another package nothing is known
        if conflict := shadowing_package():
            raise ImportError(conflict) from error
        raise


if __name__ == "__main__":
    sys.exit(main())
