"""Step an ir-sim world on request, in the virtual environment of ir-sim.

It runs with the Python of that environment and imports nothing of this project. Each line on
standard input is a number of steps; each reply is one JSON line.
"""

import importlib
import json
import sys
import time
from importlib.metadata import version
from typing import Any

CIRCLING = [0.05, 0.5]
"""Forward speed and yaw rate of a circle without contact."""


def main() -> None:
    """Make the world and run the requested steps until standard input ends."""
    environment: Any = importlib.import_module("irsim").make(
        sys.argv[1], headless=True, log_level="ERROR"
    )
    environment.step(CIRCLING)
    facts = {"version": version("ir-sim"), "rays": len(environment.get_lidar_scan()["ranges"])}
    for line in sys.stdin:
        print(json.dumps(facts | timed(environment, int(line))), flush=True)


def timed(environment: Any, steps: int) -> dict[str, float]:
    """Return CPU and wall time of this many steps."""
    cpu, wall = time.process_time(), time.perf_counter()
    for _ in range(steps):
        environment.step(CIRCLING)
    return {"cpu_s": time.process_time() - cpu, "wall_s": time.perf_counter() - wall}


if __name__ == "__main__":
    main()
