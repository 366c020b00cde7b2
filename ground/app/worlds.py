"""What there is to know of worlds: from the plant's side, and how runs in them have ended."""

import os
from pathlib import Path
from typing import Any, Final

from ground.launch.child_command import command
from ground.launch.scenario import world_facts

OUTCOMES: Final = Path(__file__).parents[2] / "docs" / "evidence" / "outcomes.md"
NOISE: Final = "default"
COLUMNS: Final = 10
"""World, navigator, noise, how it ended in seven columns, and the ends of ten seeds."""

Reached = dict[str, dict[str, int]]


def query_worlds(*words: str) -> dict[str, Any]:
    """What `sidestep worlds` says; UserError with its words when it refuses."""
    return world_facts(command(["worlds", *words, "--json"], os.getpid()))


def read_reached_counts(path: Path = OUTCOMES) -> Reached:
    """By world and navigator, how many of ten seeds reached the goal with the usual noise.

    Empty where the sources, and with them what the study found, are not there.
    """
    found: Reached = {}
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except OSError:
        return found
    for line in lines:
        cells = [cell.strip() for cell in line.strip("|").split("|")]
        if len(cells) == COLUMNS and cells[2] == NOISE:
            found.setdefault(cells[0], {})[cells[1].replace(",", "")] = reached_count(cells[-1])
    return found


def reached_count(ends: str) -> int:
    """`7 reached, 3 stuck` is 7."""
    counts = (end.partition(" ") for end in ends.split(", "))
    return sum(int(count) for count, _, how in counts if how == "reached")
