"""Update the output of commands in pages: `python -m tests.support.docs.refresh PAGE...`.

Only blocks whose output does not match any more are changed. Look at the difference afterwards: a
line `...` that stood in such a block is gone.
"""

import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

from tests.support.docs.console import Command, matches, steps_of
from tests.support.docs.session import session


def refresh(page: Path) -> int:
    """Run the commands of a page and rewrite the outputs that differ; return their number."""
    changed: list[tuple[Command, list[str]]] = []
    with tempfile.TemporaryDirectory() as folder, session(Path(folder)) as shell:
        for step in steps_of(page):
            printed = shell.run(step)
            if not isinstance(step, Command) or printed is None:
                continue
            if not matches(step.output, printed, is_exact=step.is_exact):
                changed.append((step, printed))
    lines = page.read_text(encoding="utf-8").splitlines()
    for command, printed in reversed(changed):
        start = command.line
        while lines[start - 1].endswith("\\"):
            start += 1
        lines[start : start + len(command.output)] = printed
    page.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return len(changed)


def main(argv: Sequence[str]) -> int:
    """Refresh each page; the exit code is 0."""
    for name in argv:
        print(f"{name}: {refresh(Path(name))} outputs renewed")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
