"""Trials with compiled modules, in pure Python and of ir-sim without controller, in turn.

The compiled installation is built first. With `--before` an older checkout takes part, for the
table of stages. The three children take turns in each world, so that a load on the machine slows
all of them.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from statistics import median
from typing import Any, Final

from checks.built import ROOT, install_compiled
from checks.harness.figures import Figure, Report, digits, ratios
from checks.speed import irsim as irsim_peer
from plant.world.file import load

STAGES: Final = Path(__file__).with_name("stages.py")
LIMITS: Final = {"compiled": (2000.0, 25.0), "pure": (600.0, 8.0)}
"""Least pace, and least ratio to ir-sim."""
PEER_STEPS = 150
PERIOD_S = 0.05

Measured = dict[str, list[Any]]
"""Replies of each child, by its name."""


class Child:
    """A process that measures trials with the packages of one folder."""

    def __init__(self, process: "subprocess.Popen[str]") -> None:
        self._process = process

    def measure(self, world: str) -> dict[str, Any]:
        """Return the figures of one world."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._process.stdin.write(f"{world}\n")
        self._process.stdin.flush()
        found: dict[str, Any] = json.loads(self._process.stdout.readline())
        return found


@contextmanager
def running(folder: Path) -> Iterator[Child]:
    """Start a child with the packages of a folder."""
    with subprocess.Popen(
        [sys.executable, "-P", STAGES],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(folder)},
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    ) as process:
        yield Child(process)
        process.kill()


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of this benchmark."""
    parser.add_argument("--worlds", nargs="+", default=["forest_medium", "forest_dense"])
    parser.add_argument("--repetitions", type=int, default=5)
    parser.add_argument("--before", type=Path, help="an older checkout to compare with")
    parser.add_argument("--no-peer", action="store_true", help="measure without ir-sim")
    parser.add_argument("--venv", type=Path, default=Path(".bench-venv"))
    parser.add_argument("--page", type=Path, help="write the table of stages to this file")


def measure(options: argparse.Namespace) -> Report:
    """Measure each world."""
    figures: list[Figure] = []
    tables: list[str] = []
    with tempfile.TemporaryDirectory() as folder, ExitStack() as stack:
        folders = {"compiled": install_compiled(Path(folder) / "installation"), "pure": ROOT}
        if options.before:
            folders["before"] = options.before.resolve()
        children = {name: stack.enter_context(running(at)) for name, at in folders.items()}
        for world in options.worlds:
            found = in_turn(world, children, options)
            assert found["compiled"][0]["compiled"]
            figures += figures_of(world, found)
            tables.append(table(world, found))
    if options.page:
        options.page.write_text(page(tables, figures, options.before), encoding="utf-8")
    return Report(benchmark="compiled", figures=tuple(figures))


def in_turn(world: str, children: Mapping[str, Child], options: argparse.Namespace) -> Measured:
    """Measure a world with every child, and ir-sim's pace, some times in turn."""
    found: Measured = {name: [] for name in (*children, "ir-sim")}
    with ExitStack() as stack:
        peer = None
        if not options.no_peer:
            peer = stack.enter_context(irsim_peer.running(load(world), options.venv))
        for _ in range(options.repetitions):
            for name, child in children.items():
                found[name].append(child.measure(world))
            if peer is not None:
                cpu_s, _ = peer.run(PEER_STEPS)
                found["ir-sim"].append(PEER_STEPS * PERIOD_S / cpu_s)
    return found


def figures_of(world: str, found: Measured) -> Iterator[Figure]:
    """Yield pace and ratios of a world; ratios are those of neighbours in time."""
    paces = {name: [one["pace"] for one in found[name]] for name in found if name != "ir-sim"}
    for name, (least, least_ratio) in LIMITS.items():
        yield Figure(name=f"{world}, {name}", unit="x", values=tuple(paces[name]), at_least=least)
        if found["ir-sim"]:
            over = ratios(paces[name], found["ir-sim"])
            title = f"{world}, {name} / ir-sim"
            yield Figure(name=title, unit="x", values=over, at_least=least_ratio)
    over = ratios(paces["compiled"], paces["pure"])
    yield Figure(name=f"{world}, compiled / pure", unit="x", values=over)
    same = float(len({one["digest"] for name in LIMITS for one in found[name]}) == 1)
    yield Figure(name=f"{world}, equal digests", unit="", values=(same,), at_least=1.0)


def table(world: str, found: Measured) -> str:
    """Return the cost of each stage as a table in Markdown."""
    names = [name for name in ("before", "pure", "compiled") if name in found]
    lines = [f"## {world}", "", "| stage | " + " | ".join(f"{name}, us" for name in names) + " |"]
    lines.append("|---|" + "---|" * len(names))
    for stage in found["pure"][0]["stages_us"]:
        costs = [median(one["stages_us"][stage] for one in found[name]) for name in names]
        lines.append(f"| {stage} | " + " | ".join(f"{cost:.1f}" for cost in costs) + " |")
    whole = [median(one["whole_us"] for one in found[name]) for name in names]
    lines.append("| whole trial | " + " | ".join(f"{cost:.1f}" for cost in whole) + " |")
    return "\n".join(lines)


def commit_of(folder: Path) -> str:
    """Return the commit that is checked out in a folder."""
    words = ("git", "-C", str(folder), "describe", "--always", "--dirty")
    return subprocess.run(words, capture_output=True, text=True, check=False).stdout.strip()


def page(tables: Sequence[str], figures: Sequence[Figure], before: Path | None = None) -> str:
    """Return the page of evidence; `before` is the older checkout."""
    older = f"commit `{commit_of(before)}`" if before else "an older commit"
    head = (
        "# Compiled modules\n\n"
        "Made by `sidestep bench compiled --page docs/evidence/compiled.md`. CPU time of one"
        " control period, medians.\n*pure* is this commit in pure Python, *compiled* the same"
        f" sources compiled with mypyc, *before* {older}.\nA stage is measured alone, along"
        " the path of a recorded trial; *rest* is the difference to the whole trial\nwith its"
        " set-up. The machine was shared: rely on ratios."
    )
    rows = ["| figure | median | spread | at least |", "|---|---|---|---|"]
    for one in figures:
        spread = f"{digits(min(one.values))} to {digits(max(one.values))}"
        least = "" if one.at_least is None else f"{one.at_least:g}"
        rows.append(f"| {one.name} | {digits(one.median)} {one.unit} | {spread} | {least} |")
    return "\n\n".join([head, "\n".join(rows), *tables]) + "\n"
