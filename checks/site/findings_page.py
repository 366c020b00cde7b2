"""`python -m checks.site.findings_page`: the committed findings of the falsifier as a table.

The files in `study/falsify/worlds` have all that it shows. After a change of the core first run
`python -m checks.findings`.
"""

from collections.abc import Iterable
from pathlib import Path
from typing import Final

from checks.findings import WORLDS
from checks.site.reference import table
from study.falsify.climb import class_of
from study.falsify.findings import Finding, read_finding
from study.falsify.shrink import walls_in
from study.report.page import with_text

PAGE: Final = Path(__file__).resolve().parents[2] / "docs" / "evidence" / "falsifier.md"
BEGIN: Final = "<!-- begin: python -m checks.site.findings_page -->\n"
END: Final = "<!-- end: python -m checks.site.findings_page -->\n"
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
