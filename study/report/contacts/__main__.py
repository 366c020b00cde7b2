"""`python -m study.report.contacts STUDY`: explain the contacts by own motion, one by one."""

import argparse
import sys
from collections.abc import Sequence
from functools import partial
from pathlib import Path

from study.report.contacts.page import explain_all, file_of, page_of
from study.runner.sources import world_of
from study.runner.store import read


def main(argv: Sequence[str] | None = None) -> int:
    """Write the page and its drawings, and remove drawings of earlier pages."""
    options = parser().parse_args(argv)
    table = read(options.study)
    found = explain_all(table, partial(world_of, directory=options.study))
    folder: Path = options.page.with_suffix("")
    folder.mkdir(parents=True, exist_ok=True)
    for old in folder.glob("*.svg"):
        old.unlink()
    for one in found:
        (folder / file_of(one)).write_text(one.drawing.alone(), encoding="utf-8", newline="\n")
    text = page_of(found, table, folder.name)
    options.page.write_text(text, encoding="utf-8", newline="\n")
    print(f"{options.page}: {len(found)} contacts")
    return 0


def parser() -> argparse.ArgumentParser:
    """Return the parser of the command line."""
    made = argparse.ArgumentParser(prog="python -m study.report.contacts", description=__doc__)
    made.add_argument("study", type=Path, metavar="STUDY", help="the study's directory")
    made.add_argument("--page", type=Path, required=True, metavar="FILE", help="page to write")
    return made


if __name__ == "__main__":
    sys.exit(main())
