"""`python -m checks.findings`: drive the committed findings again and rewrite their files.

Run it after a change of the core: the findings that still fail get the present sentence, kind of
end, file name and picture. Those in `fixed` keep what was found. The page of the findings follows
by `python -m checks.site.findings_page`.
"""

import argparse
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final

from runtime.errors import UserError
from study.falsify.climb import class_of
from study.falsify.findings import Finding, finding_of, picture, read_finding, save_finding

WORLDS: Final = Path(__file__).resolve().parents[1] / "study" / "falsify" / "worlds"
FAILING: Final = ("open", "paper")
"""Folders whose findings still fail."""


def main(argv: Sequence[str] | None = None) -> int:
    """Rewrite the findings that still fail; return 1 if one holds now."""
    parser = argparse.ArgumentParser(prog="python -m checks.findings", description=__doc__)
    parser.add_argument(
        "files", nargs="*", type=Path, help="files of findings (all that still fail by default)"
    )
    options = parser.parse_args(argv)
    holding = 0
    for file in options.files or failing(WORLDS):
        new = renewed(file)
        holding += new is None
        print(f"{file}: {'holds now, move it to fixed/' if new is None else rewrite(file, new)}")
    return int(holding > 0)


def failing(worlds: Path) -> list[Path]:
    """Return the files of the findings that still fail."""
    return [file for name in FAILING for file in sorted((worlds / name).glob("*.toml"))]


def renewed(file: Path) -> Finding | None:
    """Drive the trial of a finding and return it as it fails now; None if it holds."""
    old = read_finding(file)
    result = old.replay()
    if old.letter not in result.violated:
        return None
    name = name_of(file, old, result.kind)
    made = finding_of(old.subject, old.letter, result, old.limit_s, name)
    return replace(made, found=old.found)


def name_of(file: Path, old: Finding, kind: str) -> str:
    """Return the name of a file with another kind of end; raise UserError if it is taken."""
    stored = class_of(old.letter, old.world.family or "", old.kind)
    before, found, after = file.stem.partition(stored)
    if not found:
        raise UserError(f"{file}: its name does not contain its class {stored}; rename it")
    name = f"{before}{class_of(old.letter, old.world.family or '', kind)}{after}"
    if name != file.stem and file.with_name(f"{name}.toml").exists():
        raise UserError(f"{file}: {name}.toml exists; add a word to one of the two names")
    return name


def rewrite(file: Path, new: Finding) -> str:
    """Write a finding in the folder of its file, and remove the file of another name."""
    save_finding(file.parent, new, picture(new))
    if new.world.name != file.stem:
        file.unlink()
        file.with_suffix(".svg").unlink(missing_ok=True)
    return f"{new.world.name}: {new.sentence}"


if __name__ == "__main__":
    sys.exit(main())
