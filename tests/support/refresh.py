"""Renew the pictures of screens and the outputs on pages, and show the difference: `make refresh`.

`ARGS="screens"`, a page, or a folder of pages renews a part. A block whose output matches is left
alone; in another block the lines that match stay. A block that another file runs is not run here,
and that file is named. A page whose command fails keeps its text, the other pages are still
renewed, and the exit code is 1. Files are replaced as a whole.
"""

import argparse
import os
import signal
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Final

from runtime import files as atomic_file
from runtime.errors import EXIT_INTERRUPTED
from tests.support.pages import (
    ANYTHING,
    PAGES,
    PROMPT,
    ROOT,
    Command,
    matches,
    renewed,
    session,
    steps,
)

SCREENS: Final = "screens"
SNAPSHOTS: Final = Path("docs", "pictures", "screens")
FIXTURE: Final = "update_screens:"
"""Each test that draws a picture takes this fixture."""


def renew_page(page: Path) -> str:
    """Run the commands of a page and replace the outputs that differ; return what was done.

    Raises RuntimeError or OSError, and leaves the page alone then.
    """
    text = page.read_text(encoding="utf-8")
    asked = list(steps(text.splitlines()))
    commands = [step for step in asked if isinstance(step, Command)]
    changed: list[tuple[Command, list[str]]] = []
    with tempfile.TemporaryDirectory() as folder, session(Path(folder)) as shell:
        for step in asked:
            printed = shell.run(step)
            if not isinstance(step, Command) or printed is None:
                continue
            if not matches(step.output, printed, is_exact=step.is_exact):
                lines = [line.replace(folder, ANYTHING) for line in printed]
                changed.append((step, renewed(step.output, lines, is_exact=step.is_exact)))
    if changed:
        new = replaced(text, changed)
        if [step.words for step in steps(new.splitlines()) if isinstance(step, Command)] != [
            command.words for command in commands
        ]:
            raise RuntimeError(f"an output has a line that begins with `{PROMPT}` or ends a block")
        if page.read_text(encoding="utf-8") != text:
            raise RuntimeError("the page was edited meanwhile: call this again")
        atomic_file.replace(page, new)
    others = sorted({command.runner for command in commands if command.runner is not None})
    here = sum(command.runner is None for command in commands)
    done = f"{len(changed)} of {here} outputs renewed"
    return f"{done}; others, not renewed, are run by {', '.join(others)}" if others else done


def replaced(text: str, outputs: Sequence[tuple[Command, list[str]]]) -> str:
    """Return the text of a page with these outputs of its commands."""
    lines = text.splitlines()
    for command, output in reversed(outputs):
        indent = lines[command.line - 1].partition(PROMPT)[0]
        start = command.line
        while lines[start - 1].endswith("\\"):
            start += 1
        lines[start : start + len(command.output)] = [
            f"{indent}{line}" if line else "" for line in output
        ]
    return "\n".join(lines) + "\n"


def renew_screens() -> str:
    """Draw all pictures of screens; return what pytest says. Raises RuntimeError."""
    files = [
        str(path)
        for path in sorted((ROOT / "tests" / "tui").rglob("test_*.py"))
        if FIXTURE in path.read_text(encoding="utf-8")
    ]
    words = (sys.executable, "-m", "pytest", "-q", "-n", str(os.cpu_count() or 1))
    done = subprocess.run(
        (*words, "--update-screens", *files),
        cwd=ROOT,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        check=False,
    )
    if done.returncode:
        raise RuntimeError(done.stdout)
    return done.stdout.splitlines()[-1]


@contextmanager
def difference_shown(root: Path, paths: Sequence[Path]) -> Iterator[None]:
    """Show at the end what has changed below the paths since the beginning.

    What was uncommitted at the beginning is not shown: a repository of its own holds that state.
    """
    with tempfile.TemporaryDirectory() as folder:

        def git(*words: str) -> int:
            sys.stdout.flush()
            repository = ("--no-pager", "--git-dir", folder, "--work-tree", str(root))
            return subprocess.run(("git", *repository, *words), cwd=root, check=False).returncode

        git("init", "--quiet")
        git("add", "--", *map(str, paths))
        try:
            yield
        finally:
            git("add", "--intent-to-add", "--", *map(str, paths))
            if git("diff", "--exit-code", "--stat", "--patch") == 0:
                print("nothing has changed")


def pages_in(part: str) -> list[Path]:
    """Return the page with this path, or those in the folder that have commands; else none."""
    path = Path(part).resolve()
    pages = [path] if path.is_file() else sorted(path.rglob("*.md"))
    return [page for page in pages if PROMPT in page.read_text(encoding="utf-8")]


def main(argv: Sequence[str] | None = None, root: Path = ROOT) -> int:
    """Renew all or the given parts; 1 if one of them failed."""
    parser = argparse.ArgumentParser(
        prog="make refresh", description=(__doc__ or "").split("\n")[0]
    )
    parser.add_argument("parts", nargs="*", metavar="PART", help="screens, a page, or a folder")
    parts: list[str] = parser.parse_args(argv).parts
    pages: list[Path] = [] if parts else list(PAGES)
    for part in parts:
        found = [] if part == SCREENS else pages_in(part)
        if part != SCREENS and not found:
            parser.error(f"{part}: no page with commands; give a page, a folder, or {SCREENS}")
        pages += found
    renewals: list[tuple[str, Callable[[], str]]] = [
        (os.path.relpath(page, root), partial(renew_page, page)) for page in pages
    ]
    if not parts or SCREENS in parts:
        renewals.insert(0, (SCREENS, renew_screens))
        pages.append(root / SNAPSHOTS)
    # A job in the background of a shell ignores it, and so would every process of a page.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    failed = []
    try:
        with difference_shown(root, pages):
            for name, renew in renewals:
                try:
                    done = renew()
                except (OSError, RuntimeError) as error:
                    failed.append(name)
                    done = f"FAILED\n{error}"
                print(f"{name}: {done}", flush=True)
    except KeyboardInterrupt:
        return EXIT_INTERRUPTED
    if failed:
        print(f"\nmake refresh: FAILED: {', '.join(failed)}", file=sys.stderr)
    return int(bool(failed))


if __name__ == "__main__":
    sys.exit(main())
