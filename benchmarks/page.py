"""`python -m benchmarks.page`: run every benchmark, write docs/evidence/figures.md.

Each is run by its own command, so that none meets what another left behind. A figure that misses
its threshold is written down like any other.
"""

import argparse
import json
import subprocess
import sys
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Final

from benchmarks.__main__ import BENCHMARKS
from verification.harness.figures import digits

HOURS: Final = ("--hours", "10")
OPTIONS: Final[Mapping[str, tuple[str, ...]]] = {"robot": HOURS, "faults": ("--short",)}
HEAD: Final = "| figure | median | spread | threshold | |\n|---|---|---|---|---|"


def main(argv: Sequence[str] | None = None) -> int:
    """0 when every figure was measured, met or missed; 1 when a benchmark broke down."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.page", description=__doc__)
    parser.add_argument("names", nargs="*", metavar="NAME", default=list(BENCHMARKS))
    parser.add_argument("--output", type=Path, default=Path("docs/evidence/figures.md"))
    options = parser.parse_args(argv)
    sections = [introduction()]
    for name in options.names:
        print(f"{name} ...", file=sys.stderr)
        arguments = (name, *OPTIONS.get(name, ()))
        report = measured(arguments)
        if report is None:
            return 1
        sections.append(section(arguments, report))
    options.output.write_text("\n\n".join(sections) + "\n", encoding="utf-8")
    return 0


def introduction() -> str:
    return (
        "# Figures\n\n"
        f"Measured on {datetime.now(UTC):%Y-%m-%d} by `python -m benchmarks.page`. Each section"
        " names the command that\nmakes it again. The median of the repetitions is judged;"
        " the spread is their minimum and maximum.\nMachines differ and this one was shared:"
        " take ratios from here rather than times."
    )


def measured(arguments: Sequence[str]) -> dict[str, Any] | None:
    """The report of one benchmark; None, said on standard error, when it broke down."""
    command = [sys.executable, "-m", "benchmarks", *arguments, "--json"]
    done = subprocess.run(command, stdout=subprocess.PIPE, check=False)
    try:
        report: dict[str, Any] = json.loads(done.stdout)
    except ValueError:
        print(f"{' '.join(arguments)}: no report, exit code {done.returncode}", file=sys.stderr)
        return None
    return report


def section(arguments: Sequence[str], report: Mapping[str, Any]) -> str:
    """One benchmark as Markdown."""
    machine = ", ".join(f"{key} {value}" for key, value in report["machine"].items())
    lines = [
        f"## {report['benchmark']}: {BENCHMARKS[arguments[0]]}",
        "",
        f"`sidestep bench {' '.join(arguments)}`, {machine}",
        "",
        HEAD,
        *(row(figure) for figure in report["figures"]),
    ]
    if report["notes"]:
        lines += ["", *(f"- {note}" for note in report["notes"])]
    return "\n".join(lines)


def row(figure: Mapping[str, Any]) -> str:
    low, high = figure["at_least"], figure["at_most"]
    wanted = f">= {low:g}" if low is not None else f"<= {high:g}" if high is not None else ""
    verdict = {None: "", True: "met", False: "**missed**"}[figure["met"]]
    spread = ""
    if len(figure["values"]) > 1:
        spread = f"{digits(figure['minimum'])} to {digits(figure['maximum'])}"
    median = f"{digits(figure['median'])} {figure['unit']}".strip()
    return f"| {figure['name']} | {median} | {spread} | {wanted} | {verdict} |"


if __name__ == "__main__":
    sys.exit(main())
