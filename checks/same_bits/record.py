"""Results of the comparison, as JSON, and the page made from it."""

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Final

import msgspec

EXAMPLES: Final = 3
HEAD: Final = "| variant | trials | digests that differ | commit | date |\n|---|---|---|---|---|"


class VariantRow(msgspec.Struct, frozen=True):
    """One variant: number of trials, and those that differ from the usual environment."""

    variant: str
    trials: int
    differing: list[str]
    commit: str
    date: str
    control: bool = False
    """Whether the commit is an older one, whose digests are expected to differ."""


class Functions(msgspec.Struct, frozen=True):
    """Number of values that differ in one variant, for each function of a library."""

    variant: str
    values: int
    differing: dict[str, int]


class BitsRecord(msgspec.Struct):
    """All variants compared so far, and where."""

    machine: str = ""
    ends: str = ""
    """How the trials ended, with their numbers."""
    rows: list[VariantRow] = []
    functions: list[Functions] = []
    notes: list[str] = []
    """Remarks written by hand in the JSON file."""

    def add(self, row: VariantRow) -> None:
        """Add a row; it replaces the one of the same variant."""
        key = (row.variant, row.control)
        self.rows = [one for one in self.rows if (one.variant, one.control) != key]
        self.rows.append(row)

    def add_functions(self, found: Functions) -> None:
        """Add the result of a variant; it replaces an older one."""
        self.functions = [one for one in self.functions if one.variant != found.variant]
        self.functions.append(found)


def read(path: Path) -> BitsRecord:
    """Return the record in a file, an empty one if there is none."""
    return (
        msgspec.json.decode(path.read_bytes(), type=BitsRecord) if path.exists() else BitsRecord()
    )


def write(record: BitsRecord, page: Path) -> None:
    """Write the page, and the record as JSON beside it."""
    text = msgspec.json.format(msgspec.json.encode(record), indent=1)
    page.with_suffix(".json").write_bytes(text + b"\n")
    page.write_text(page_of(record), encoding="utf-8")


def page_of(record: BitsRecord) -> str:
    """Return the page of evidence."""
    rows = [row for row in record.rows if not row.control]
    control = [row for row in record.rows if row.control]
    compared, differing = sum(row.trials for row in rows), sum(len(row.differing) for row in rows)
    parts = [
        "# Same bits",
        "Made by `python -m checks.same_bits --libraries --compiled --page"
        " docs/evidence/same-bits.md`.\nEach variant runs the same random trials of the corpus:"
        " any family, navigator, side, noise level, seed and start\ntime, at most 20 simulated"
        " seconds. The digest of a trial covers every bit of its trajectory.\nThe reference is the"
        f" usual environment on the same machine.\n{differing} of {compared} digests differ.",
        f"Machine: {record.machine}. Ends of the trials: {record.ends}.",
        table(rows),
        *record.notes,
    ]
    if control:
        parts += [
            "## Control",
            "The same comparison at an older commit, which used the C library's functions, numpy's"
            " generator and pymunk's\nsolver. Short trials hide most differences of a last bit: a"
            " step is a thousand times smaller than the position\nit is added to.",
            table(control),
            *examples(control),
        ]
    if record.functions:
        parts += [
            "## Functions of libraries",
            f"The table counts the values that differ from those in the usual environment, of"
            f" {record.functions[0].values} values of each function.\nNo result of a trial depends"
            " on them.",
            table_of_functions(record.functions),
        ]
    return "\n\n".join(parts) + "\n"


def table_of_functions(found: Sequence[Functions]) -> str:
    """Return the table of differing values, one column for each function."""
    names = list(found[0].differing)
    head = f"| variant | {' | '.join(names)} |\n|---|{'---|' * len(names)}"
    lines = (
        f"| {one.variant} | {' | '.join(str(one.differing[name]) for name in names)} |"
        for one in found
    )
    return "\n".join([head, *lines])


def table(rows: Iterable[VariantRow]) -> str:
    """Return the table of rows."""
    lines = (
        f"| {row.variant} | {row.trials} | {len(row.differing)} | `{row.commit}` | {row.date} |"
        for row in rows
    )
    return "\n".join([HEAD, *lines])


def examples(rows: Sequence[VariantRow]) -> list[str]:
    """Return a paragraph with some trials that differ, if there are any."""
    found = dict.fromkeys(name for row in rows for name in row.differing[:EXAMPLES])
    names = ", ".join(f"`{name}`" for name in [*found][:EXAMPLES])
    return [f"Some that differ: {names}."] if names else []
