"""Run ir-sim with the same world, robot and rays, in its own virtual environment."""

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from math import pi
from pathlib import Path
from typing import Any

from protocol.world import Circle, Obstacle, Polygon, World

REQUIREMENT = "ir-sim>=2.10"
DRIVER = Path(__file__).with_name("irsim_driver.py")
PERIOD_S = 0.05
RAYS = 40


class IrSim:
    """A child process that steps the world."""

    def __init__(self, child: "subprocess.Popen[str]") -> None:
        self._child = child
        greeting = self._answer()
        self.version: str = greeting["version"]
        if greeting["rays"] != RAYS:
            raise RuntimeError(f"ir-sim casts {greeting['rays']} rays instead of {RAYS}")

    def run(self, steps: int) -> tuple[float, float]:
        """Run the steps; return CPU and wall time in s."""
        assert self._child.stdin is not None
        self._child.stdin.write(f"{steps}\n")
        self._child.stdin.flush()
        answer = self._answer()
        return answer["cpu_s"], answer["wall_s"]

    def _answer(self) -> Any:
        """Return the next JSON line; ir-sim prints on standard output too."""
        assert self._child.stdout is not None
        for line in self._child.stdout:
            if line.startswith("{"):
                return json.loads(line)
        raise RuntimeError("ir-sim exited without a reply")


@contextmanager
def running(world: World, venv: Path) -> Iterator[IrSim]:
    """Start ir-sim with this world."""
    python = prepared(venv)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "world.yaml"
        path.write_text(json.dumps(scene_of(world)), encoding="utf-8")  # JSON is YAML
        with subprocess.Popen(
            [python, "-P", DRIVER, path],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            env={**os.environ, "MPLBACKEND": "Agg"},
            text=True,
        ) as child:
            try:
                yield IrSim(child)
            finally:
                child.kill()


def prepared(venv: Path) -> Path:
    """Return the Python of the virtual environment, which is made on first use."""
    python = venv / "bin" / "python"
    if not python.exists():
        subprocess.run([sys.executable, "-m", "venv", venv], check=True)
    have = subprocess.run([python, "-c", "import irsim"], capture_output=True, check=False)
    if have.returncode != 0:
        print(f"installing {REQUIREMENT} in {venv}", file=sys.stderr)
        subprocess.run([python, "-m", "pip", "install", "-q", REQUIREMENT], check=True)
    return python


def scene_of(world: World) -> dict[str, Any]:
    """Return the world in ir-sim's format; raise ValueError for what ir-sim cannot represent."""
    width_m, height_m = world.size_m
    obstacles = [_obstacle(obstacle) for obstacle in world.obstacles]
    if world.walls:
        corners = [[0, 0], [width_m, 0], [width_m, height_m], [0, height_m], [0, 0]]
        obstacles.append({"shape": {"name": "linestring", "vertices": corners}})
    return {
        "world": {
            "width": width_m,
            "height": height_m,
            "step_time": PERIOD_S,
            "sample_time": PERIOD_S,
        },
        "robot": [_robot(world)],
        "obstacle": obstacles,
    }


def _robot(world: World) -> dict[str, Any]:
    start, goal = world.start, world.goal
    lidar = {
        "name": "lidar2d",
        "range_min": 0.02,
        "range_max": 3.0,
        "angle_range": pi,
        "number": RAYS,
    }
    return {
        "kinematics": {"name": "diff"},
        "shape": {"name": "circle", "radius": 0.12},
        "state": [start.x_m, start.y_m, start.heading_rad],
        "goal": [goal.x_m, goal.y_m, goal.heading_rad or 0.0],
        "vel_max": [0.3, 2.5],
        "sensors": [lidar],
    }


def _obstacle(obstacle: Obstacle) -> dict[str, Any]:
    if isinstance(obstacle, Circle):
        shape: dict[str, Any] = {"name": "circle", "radius": obstacle.radius_m}
        return {"shape": shape, "state": [obstacle.x_m, obstacle.y_m, 0.0]}
    if isinstance(obstacle, Polygon):
        return {"shape": {"name": "polygon", "vertices": [list(p) for p in obstacle.points_m]}}
    return {"shape": {"name": "linestring", "vertices": [list(p) for p in obstacle.points_m]}}
