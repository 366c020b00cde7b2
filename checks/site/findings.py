"""`python -m checks.site.findings`: drive the committed findings again and rewrite their files.

Run it after a change of the core: the findings that still fail get the present sentence, kind of
end, file name and picture. Those in `fixed` keep what was found. Then the table of the findings on
docs/evidence/falsifier.md is written, which has nothing but what the files have; `--page` only
writes that.
"""

import argparse
import sys
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final

from checks.site.reference import table
from runtime.errors import UserError
from study.falsify.climb import class_of
from study.falsify.findings import Finding, finding_of, picture, read_finding, save_finding
from study.falsify.shrink import walls_in
from study.report.page import with_text

PAGE: Final = Path(__file__).resolve().parents[2] / "docs" / "evidence" / "falsifier.md"
BEGIN: Final = "<!-- begin: python -m checks.site.findings -->\n"
END: Final = "<!-- end: python -m checks.site.findings -->\n"
FIRST: Final = "the first search"
"""How the note `found` of the findings of the first search begins."""

FOLDERS: Final = {
    "open": "Open: `vgm_memory` still fails",
    "fixed": "Fixed: `vgm_memory` must not fail again",
    "paper": "Methods of the paper",
}


def write_page(file: Path = PAGE) -> None:
    """Rewrite the tables of the page."""
    page = file.read_text(encoding="utf-8")
    file.write_text(with_tables(page, WORLDS), encoding="utf-8")


def with_tables(page: str, worlds: Path) -> str:
    """Return the page with new tables between its marks; raise ValueError without marks."""
    return with_text(page, BEGIN, END, f"\n{tables(worlds)}\n")


def tables(worlds: Path) -> str:
    """Return the tables of all folders, and the classes of the first search."""
    findings = {
        name: {file.stem: read_finding(file) for file in sorted((worlds / name).glob("*.toml"))}
        for name in FOLDERS
    }
    parts = [first_search([*findings["open"].values(), *findings["fixed"].values()])]
    for name, title in FOLDERS.items():
        parts.append(f"### {title}\n\n{table_of(name, findings[name])}\n")
    return "\n".join(parts)


def first_search(findings: Iterable[Finding]) -> str:
    """Return the number of classes of the first search as a paragraph."""
    marked = [one for one in findings if one.found.startswith(FIRST)]
    fixed = sum(bool(one.fixed) for one in marked)
    return (
        f"The first search found {len(marked)} of these classes, when the claims of `vgm_memory`"
        f" had no proof yet. They\nare marked with *first*. {fixed} of them are fixed,"
        f" {len(marked) - fixed} are open.\n"
    )


def table_of(folder: str, findings: dict[str, Finding]) -> str:
    """Return the table of a folder; the link of a finding leads to its picture."""
    head = ["finding", "class", "walls", "failure", "found by"]
    rows = [
        [
            f"[{stem}](../pictures/findings/{folder}/{stem}.svg)",
            class_of(one.letter, one.world.family or "", one.kind),
            walls_in(one.world),
            one.sentence,
            found_by(one),
            *([f"`{one.fixed}`"] if folder == "fixed" else []),
        ]
        for stem, one in findings.items()
    ]
    return table([*head, *(["fixed by"] if folder == "fixed" else [])], rows)


def found_by(finding: Finding) -> str:
    """Return the search that found a finding."""
    if finding.found.startswith(FIRST):
        return f"*first*{finding.found.removeprefix(FIRST)}"
    return finding.found or "a later search"


WORLDS: Final = Path(__file__).resolve().parents[2] / "study" / "falsify" / "worlds"
FAILING: Final = ("open", "paper")
"""Folders whose findings still fail."""


def main(argv: Sequence[str] | None = None) -> int:
    """Rewrite the findings that still fail; return 1 if one holds now."""
    parser = argparse.ArgumentParser(prog="python -m checks.site.findings", description=__doc__)
    parser.add_argument(
        "files", nargs="*", type=Path, help="files of findings (all that still fail by default)"
    )
    parser.add_argument("--page", action="store_true", help="only write the table of the page")
    options = parser.parse_args(argv)
    if options.page:
        write_page()
        return 0
    holding = 0
    for file in options.files or failing(WORLDS):
        new = renewed(file)
        holding += new is None
        print(f"{file}: {'holds now, move it to fixed/' if new is None else rewrite(file, new)}")
    if not options.files:
        write_page()
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
