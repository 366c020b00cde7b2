"""`python -m checks.site.figures_page NAME...`: run benchmarks, renew their sections on a page.

Each benchmark runs in a process of its own, so that none affects another, and its section is
written at once. The sections are between two marks; those of other benchmarks stay. Missed
thresholds are written like any other figure. `make evidence` names the measured commit on the page.
"""

import argparse
import json
import re
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from checks.__main__ import BENCHMARKS
from checks.evidence import FIGURES
from checks.harness.figures import digits
from study.report.page import with_text

HOURS: Final = ("--hours", "10")
OPTIONS: Final[Mapping[str, tuple[str, ...]]] = {"robot": HOURS}
HEAD: Final = "| figure | median | spread | threshold | |\n|---|---|---|---|---|"
BEGIN: Final = "<!-- begin: python -m checks.site.figures_page -->\n"
END: Final = "<!-- end: python -m checks.site.figures_page -->\n"
SECTION: Final = re.compile(r"^## (\w+): .*?(?=^## |\Z)", re.MULTILINE | re.DOTALL)


def main(argv: Sequence[str] | None = None) -> int:
    """Return 0 when every figure was measured, 1 when a benchmark failed."""
    parser = argparse.ArgumentParser(prog="python -m checks.site.figures_page", description=__doc__)
    parser.add_argument("names", nargs="*", metavar="NAME", default=list(FIGURES))
    parser.add_argument("--output", type=Path, default=Path("docs/evidence/figures.md"))
    options = parser.parse_args(argv)
    for name in options.names:
        print(f"{name} ...", file=sys.stderr)
        arguments = (name, *OPTIONS.get(name, ()))
        report = measured(arguments)
        if report is None:
            return 1
        text = options.output.read_text(encoding="utf-8")
        new = with_section(text, name, section(arguments, report))
        options.output.write_text(new, encoding="utf-8")
    return 0


def with_section(page: str, name: str, text: str) -> str:
    """Return the page with a new section of one benchmark, in the order of the benchmarks."""
    between = page.partition(BEGIN)[2].partition(END)[0]
    sections = {found[1]: found[0].strip() for found in SECTION.finditer(between)}
    sections[name] = text
    ordered = [sections[one] for one in BENCHMARKS if one in sections]
    return with_text(page, BEGIN, END, "\n" + "\n\n".join(ordered) + "\n\n")


def measured(arguments: Sequence[str]) -> dict[str, Any] | None:
    """Return the report of one benchmark; None, with a message on stderr, if it failed."""
    command = [sys.executable, "-m", "checks", *arguments, "--json"]
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
