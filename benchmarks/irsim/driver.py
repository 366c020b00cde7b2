"""Steps an ir-sim world as often as it is asked to, inside the environment made for ir-sim.

Started with the Python of that environment; imports nothing of ours. Each line on standard input
is a number of steps; each answer is one JSON line.
"""

import importlib
import json
import sys
import time
from importlib.metadata import version
from typing import Any

CIRCLING = [0.05, 0.5]
"""Forward speed and yaw rate: moves all the time and stays clear of everything."""


def main() -> None:
    environment: Any = importlib.import_module("irsim").make(
        sys.argv[1], headless=True, log_level="ERROR"
    )
    environment.step(CIRCLING)
    rays = len(environment.get_lidar_scan()["ranges"])
    answer({"version": version("ir-sim"), "rays": rays})
    for line in sys.stdin:
        answer(timed(environment, int(line)))


def timed(environment: Any, steps: int) -> dict[str, float]:
    cpu, wall = time.process_time(), time.perf_counter()
    for _ in range(steps):
        environment.step(CIRCLING)
    return {"cpu_s": time.process_time() - cpu, "wall_s": time.perf_counter() - wall}


def answer(what: dict[str, Any]) -> None:
    print(json.dumps(what), flush=True)


if __name__ == "__main__":
    main()
