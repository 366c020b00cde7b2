"""Sidestep: the command line, and the Python API.

The executable looks a verb up in `runtime.cli.verb_table` and imports only the package that
implements it. `import sidestep` provides the names of `ground.client.api`, each imported at its
first use:

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
    """Run one verb; return 0 for reached or done, 1 for not, 2 for wrong usage or settings."""
    if conflict := displaced("runtime", "protocol"):
        return refuse("", conflict)
    try:
        from runtime.cli.terminal import guarded_output  # the API alone needs no import
    except Exception:  # another package may raise anything
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
    """Run the verb in the arguments; print an error without its traceback."""
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
        return complain(f"unknown verb {word!r}{nearest(word, verbs)}")
    try:
        return call(verbs[word], word, rest)
    except (BrokenPipeError, KeyboardInterrupt):
        raise
    except Exception as error:
        if wants_traceback:
            raise
        return explain(word, error)


def verb_table() -> "Mapping[str, Verb]":
    """Return the verbs by name."""
    from runtime.cli.verb_table import VERBS

    return VERBS


def call(verb: "Verb", word: str, rest: Sequence[str]) -> int:
    """Run a verb, unless its package is missing or shadowed by another one."""
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
    """Return a text about the first package for which Python finds another one, or ""."""
    return str(next(own("packages").displaced(packages), ""))


def shadowing_package() -> str:
    """Return a text about another package that keeps ours from working, or ""."""
    return next((str(found) for found in own("conflicts").conflicts() if found.wins), "")


def refuse(word: str, why: str) -> int:
    """Print why a verb cannot run; return the exit code."""
    print(f"{' '.join(['sidestep', *word.split()])}: {why}", file=sys.stderr)
    return EXIT_USAGE


def explain(word: str, error: Exception) -> int:
    """Print an error and return the exit code; for a defect, include its place in the code."""
    code = getattr(error, "exit_code", None)
    if isinstance(code, int):
        print(f"sidestep {word}: {error}", file=sys.stderr)
        return code
    if conflict := shadowing_package():
        return refuse(word, conflict)
    print(
        f"sidestep {word}: internal error: {type(error).__name__}: {error}{place_of(error)}\n"
        f"for the traceback: sidestep --traceback {word} ...",
        file=sys.stderr,
    )
    return 1


def place_of(error: Exception) -> str:
    """Return the innermost line of a file that was running."""
    place, innermost = error.__traceback__, ""
    while place is not None:
        path = place.tb_frame.f_code.co_filename
        if not path.startswith("<"):
            innermost = f" ({path}:{place.tb_lineno})"
        place = place.tb_next
    return innermost


def reader_gone() -> int:
    """Discard further output, as other tools do, because its reader has exited."""
    import os  # needed only when something went wrong

    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
    return EXIT_BROKEN_PIPE


def complain(message: str) -> int:
    """Print a usage error; return the exit code."""
    print(f"sidestep: {message}\n{USAGE}", file=sys.stderr)
    return EXIT_USAGE


def nearest(word: str, verbs: "Mapping[str, Verb]") -> str:
    """Return a suggestion for a misspelt verb, or ""."""
    import difflib  # needed only after a mistake

    near = difflib.get_close_matches(word, verbs, n=1)
    return f"; did you mean {near[0]!r}?" if near else ""


def overview() -> str:
    """Return the text of `sidestep --help`."""
    lines = ["Sidestep: a robot with eight sonars that finds its way around obstacles.", "", USAGE]
    group = ""
    for word, verb in verb_table().items():
        if verb.group != group:
            group = verb.group
            lines += ["", f"{group}:"]
        lines.append(f"  {word:<12} {verb.summary}")
    lines += [
        "",
        "Exit codes: 0 reached or done, 1 not, 2 usage. Details: sidestep VERB --help",
    ]
    return "\n".join(lines)


def version() -> str:
    """Return the version of the installed distribution."""
    from importlib import metadata  # slow to import, rarely needed

    try:
        return metadata.version("sidestep")
    except metadata.PackageNotFoundError:
        return "(not installed: make setup)"


def __getattr__(name: str) -> object:
    """Return a name of the API."""
    if not name.startswith("_"):
        public = public_names()
        if name in public.__all__:
            return getattr(public, name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    """Return the names of this module and of the API."""
    return sorted({*globals(), *public_names().__all__})


def public_names() -> ModuleType:
    """Return the module of the API; raise ImportError if another package shadows ours."""
    try:
        return importlib.import_module("ground.client.api")
    except Exception as error:  # another package may raise anything
        if conflict := shadowing_package():
            raise ImportError(conflict) from error
        raise


if __name__ == "__main__":
    sys.exit(main())
