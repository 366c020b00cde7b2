"""`python -m benchmarks.page`: run every benchmark, write docs/evidence/figures.md.

Each runs in a process of its own, so that none affects another. Missed thresholds are written like
any other figure.
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
    """Return 0 when every figure was measured, 1 when a benchmark failed."""
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
    """Return the head of the page."""
    return (
        "# Figures\n\n"
        f"Measured on {datetime.now(UTC):%Y-%m-%d} by `python -m benchmarks.page`. Each section"
        " names its command.\nThe threshold applies to the median of the repetitions; the spread"
        " is their minimum and maximum.\nMachines differ and this one was shared: rely on ratios"
        " rather than on times."
    )


def measured(arguments: Sequence[str]) -> dict[str, Any] | None:
    """Return the report of one benchmark; None, with a message on stderr, if it failed."""
    command = [sys.executable, "-m", "benchmarks", *arguments, "--json"]
    done = subprocess.run(command, stdout=subprocess.PIPE, check=False)
    try:
        report: dict[str, Any] = json.loads(done.stdout)
    except ValueError:
        print(f"{' '.join(arguments)}: no report, exit code {done.returncode}", file=sys.stderr)
        return None
    return report


def section(arguments: Sequence[str], report: Mapping[str, Any]) -> str:
    """Return the section of one benchmark."""
    machine = ", ".join(f"{key} {value}" for key, value in report["machine"].items())
    lines = [
        f"## {report['benchmark']}: {BENCHMARKS[arguments[0]].title}",
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
    """Return the table row of one figure."""
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
