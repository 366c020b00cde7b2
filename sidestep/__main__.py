"""The command line of Sidestep.

The executable looks a verb up in `runtime.cli.verb_table` and imports only the package that
implements it.
"""

import importlib
import importlib.util
import os
import sys
import threading
from collections.abc import Sequence
from pathlib import Path
from types import ModuleType
from typing import NoReturn

ROOT = Path(__file__).resolve().parents[1]
EXIT_USAGE = 2
EXIT_INTERRUPTED = 130
EXIT_BROKEN_PIPE = 141
"""As in `runtime.errors`, which is not imported before it is known to be ours."""

STOP_OF_ITS_OWN = "stop of its own"
OPERATOR = "ground.cli.main"

USAGE = "usage: sidestep [--traceback] [GROUP] VERB ...\n       sidestep --help | --version"


def main(argv: Sequence[str] | None = None) -> int:
    """Run one verb; return 0 for reached or done, 1 for not, 2 for wrong usage or settings.

    Without `argv` this is the executable: the process ends with its verb, so a second Ctrl-C then
    changes neither the exit code nor the output.
    """
    if argv is not None:
        return run_guarded(list(argv), ends_process=False)
    # No process needs threads for linear algebra; without them numpy starts in half the time.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    try:
        return run_guarded(sys.argv[1:], ends_process=True)
    finally:
        ignore_signals()


def run_guarded(arguments: list[str], *, ends_process: bool) -> int:
    """Run one verb with guarded output; return its exit code."""
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
            code = dispatch(arguments, ends_process=ends_process)
            sys.stdout.flush()
    except KeyboardInterrupt:
        return EXIT_INTERRUPTED
    except BrokenPipeError:
        return reader_gone()
    return code


def ignore_signals() -> None:
    """Ignore the signals that end a process, for the rest of its life."""
    import signal  # not needed to look a verb up

    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)


def dispatch(arguments: list[str], *, ends_process: bool) -> int:
    """Run the verb in the arguments; print an error without its traceback."""
    wants_traceback = arguments[:1] == ["--traceback"]
    if wants_traceback:
        del arguments[0]
    if not arguments:
        print(overview(), file=sys.stderr)
        return EXIT_USAGE
    if arguments[0] == "help" and arguments[1:]:
        arguments = [*arguments[1:], "--help"]
    word = arguments[0]
    if word in ("-h", "--help", "help"):
        print(overview())
        return 0
    if word == "--version":
        print(f"sidestep {version()}{' (compiled)' if own('compiled').is_compiled() else ''}")
        return 0
    if word == "complete":
        code: int = importlib.import_module("runtime.cli.completion").complete(arguments[1:])
        return code
    call = verbs().find(arguments)
    if call is None:
        return without_verb(arguments)
    if call.is_old:
        now = verbs().command_of(word)
        print(f"sidestep {word}: old name, use `sidestep {now}`", file=sys.stderr)
    try:
        return run(call.word, call.arguments, ends_process=ends_process)
    except (BrokenPipeError, KeyboardInterrupt):
        raise
    except Exception as error:
        if wants_traceback:
            raise
        return explain(call.word, error)


def verbs() -> ModuleType:
    """Return the module that knows the verbs; an import at the top would need its package."""
    from runtime.cli import verb_table

    return verb_table


def without_verb(words: Sequence[str]) -> int:
    """Print the help of a group, or the error of words that are no verb; return the exit code."""
    group, *rest = words
    if group not in verbs().GROUPS:
        return complain(f"unknown verb {group!r}{verbs().nearest_verb(words)}")
    if rest[:1] in (["-h"], ["--help"], ["help"]):
        print(group_help(group))
        return 0
    if not rest:
        return complain(f"which verb of {group!r}? see `sidestep {group} --help`")
    return complain(f"unknown verb '{group} {rest[0]}'{verbs().nearest_verb(words)}")


def run(word: str, arguments: Sequence[str], *, ends_process: bool) -> int:
    """Run a verb, unless its package is missing or shadowed by another one."""
    verb = verbs().VERBS[word]
    name, package = verbs().command_of(word), verb.module.partition(".")[0]
    if not (ROOT / package).is_dir():
        return refuse(
            name,
            f"needs a checkout of the source, as {package}/ is not installed: run `make setup` "
            f"there, then .venv/bin/sidestep {name}",
        )
    if conflict := displaced(package) or own("compiled").complaint():
        return refuse(name, conflict)
    if verb.is_program:
        for option in verb.hosts.keys() & set(arguments):
            importlib.import_module(verb.hosts[option])
        code: int = importlib.import_module(verb.module).main(list(arguments))
    else:
        operator = importlib.import_module(OPERATOR)
        code = operator.main([word, *arguments], ends_process=ends_process)
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
    return next((str(found) for found in own("packages").conflicts() if found.wins), "")


def refuse(name: str, why: str) -> int:
    """Print why a verb cannot run; return the exit code."""
    print(f"{f'sidestep {name}'.strip()}: {why}", file=sys.stderr)
    return EXIT_USAGE


def explain(word: str, error: Exception) -> int:
    """Print an error and return the exit code; for a defect, include its place in the code."""
    name, code = verbs().command_of(word), getattr(error, "exit_code", None)
    if isinstance(code, int):
        print(f"sidestep {name}: {error}", file=sys.stderr)
        return code
    if conflict := shadowing_package():
        return refuse(name, conflict)
    print(
        f"sidestep {name}: internal error: {type(error).__name__}: {error}{place_of(error)}\n"
        f"for the traceback: sidestep --traceback {name} ...",
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


def overview() -> str:
    """Return the text of `sidestep --help`: groups and the verbs that belong to none."""
    from runtime.cli.verb import GROUPS, MORE
    from runtime.cli.verb_table import VERBS

    lines = ["Sidestep: a robot with eight sonars that finds its way around obstacles.", "", USAGE]
    section = ""
    for word, verb in VERBS.items():
        if verb.section != section and not verb.is_grouped:
            section = verb.section
            lines += ["", f"{section}:"]
            if section == MORE:
                lines += [f"  {group:<12} {summary}" for group, summary in GROUPS.items()]
        if not verb.is_grouped:
            lines.append(f"  {word:<12} {verb.summary}")
    lines += ["", "Exit codes: 0 reached or done, 1 not, 2 usage. Details: sidestep VERB --help"]
    return "\n".join(lines)


def group_help(group: str) -> str:
    """Return the text of `sidestep GROUP --help`."""
    lines = [f"usage: sidestep {group} VERB ...", "", verbs().GROUPS[group], "", "verbs:"]
    for word, verb in verbs().VERBS.items():
        if verb.section == group:
            lines.append(f"  {verbs().command_of(word).split()[-1]:<12} {verb.summary}")
    example = next(verb.example for verb in verbs().VERBS.values() if verb.section == group)
    lines += ["", f"Details: sidestep {group} VERB --help", "", "example:", f"  sidestep {example}"]
    return "\n".join(lines)


def version() -> str:
    """Return the version of the installed distribution."""
    from importlib import metadata  # slow to import, rarely needed

    try:
        return metadata.version("sidestep")
    except metadata.PackageNotFoundError:
        return "(not installed: make setup)"


def entry() -> NoReturn:
    """Run the command line and end the process with its exit code.

    A stop that another way has delivered leaves a session of its own behind that may still dial,
    for seconds: nobody has to wait for that.
    """
    code = main()
    if any(thread.name == STOP_OF_ITS_OWN for thread in threading.enumerate()):
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)
    sys.exit(code)


if __name__ == "__main__":
    entry()
