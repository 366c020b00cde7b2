"""Read facts about worlds: from the plant, and from the outcomes of the study."""

import os
from pathlib import Path
from typing import Any, Final

from ground.launch.child_command import command
from ground.launch.scenario import world_facts

OUTCOMES: Final = Path(__file__).parents[2] / "docs" / "evidence" / "outcomes.md"
NOISE: Final = "default"
COLUMNS: Final = 10
"""World, navigator, noise, seven columns of results, and the outcomes of ten seeds."""

Reached = dict[str, dict[str, int]]


def query_worlds(*words: str) -> dict[str, Any]:
    """Return the JSON of `sidestep worlds`. Raise UserError with its message when it fails."""
    return world_facts(command(["worlds", *words, "--json"], os.getpid()))


def read_reached_counts(path: Path = OUTCOMES) -> Reached:
    """Return, by world and navigator, how many of ten seeds reached the goal with default noise.

    Empty without a source tree, which contains the outcomes of the study.
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
    """Return 7 for `7 reached, 3 stuck`."""
    counts = (end.partition(" ") for end in ends.split(", "))
    return sum(int(count) for count, _, how in counts if how == "reached")
