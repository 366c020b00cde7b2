"""Time from the start of the app's process to a screen with the robot's name.

Bare Python and Python with Textual are started in turn with it, so that all meet the same load.
"""

import argparse
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from time import monotonic_ns
from typing import Final

from checks.harness.figures import Figure
from checks.harness.observer import Observer, observed
from checks.speed.ground_station.stage import SIZES, on_terminal
from runtime.units import NS_PER_S

AT_MOST_S: Final = 0.6
WORLD: Final = "forest_medium"
PAINTED: Final = "Palette"
"""Last word of the key bar, which is the last row."""
PATIENCE_S: Final = 30.0
FLOORS: Final = ("pass", "import textual.app")


def paint_figures(options: argparse.Namespace) -> tuple[list[Figure], list[str]]:
    """Measure the first paint and its baselines."""
    with observed(WORLD) as observer, tempfile.TemporaryDirectory() as bytecode:
        in_turn(observer, Path(bytecode))  # compiles the imported modules
        rows = [in_turn(observer, Path(bytecode)) for _ in range(options.starts)]
    names = ["first paint", "first bytes", *(f"python -c '{line}'" for line in FLOORS)]
    figures = [
        Figure(
            name=name,
            unit="s",
            values=tuple(row[at] for row in rows),
            at_most=AT_MOST_S if name == names[0] else None,
        )
        for at, name in enumerate(names)
    ]
    quotients = tuple(row[0] / row[3] for row in rows)
    figures.append(Figure(name=f"first paint / '{FLOORS[1]}'", unit="x", values=quotients))
    figures.append(
        Figure(name="CPU time until the first paint", unit="s", values=tuple(r[4] for r in rows))
    )
    return figures, [
        "first paint: the whole screen, with the robot found, at 80x24; its modules compiled before"
    ]


def in_turn(observer: Observer, bytecode: Path) -> tuple[float, float, float, float, float]:
    """Return seconds to paint and to first output, of both baselines, and CPU time until paint."""
    with on_terminal(observer, SIZES[0], bytecode=bytecode) as terminal:
        painted_ns = terminal.shown(PAINTED, PATIENCE_S)
        cost_s = terminal.reading().cpu_s
        paint_s, first_s = (
            (at_ns - terminal.begun_ns) / NS_PER_S for at_ns in (painted_ns, terminal.first_ns)
        )
    bare_s, textual_s = (took_s(line, bytecode) for line in FLOORS)
    return paint_s, first_s, bare_s, textual_s, cost_s


def took_s(line: str, bytecode: Path) -> float:
    """Return the time that Python takes to run one line."""
    environment = {**os.environ, "PYTHONPYCACHEPREFIX": str(bytecode)}
    environment.pop("PYTHONDONTWRITEBYTECODE", None)
    begun_ns = monotonic_ns()
    subprocess.run([sys.executable, "-c", line], check=True, env=environment)
    return (monotonic_ns() - begun_ns) / NS_PER_S
