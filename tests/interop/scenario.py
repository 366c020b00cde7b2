"""Run the scenario of a client as a process, and read the results of its steps."""

import json
import os
import subprocess
from pathlib import Path
from typing import Any, Final, NamedTuple

from checks.built import ROOT
from tests.interop.vehicle import RobotOnAir

SCENARIO_S: Final = 270.0
"""Less than what faulthandler leaves a test."""
RESULTS: Final = ROOT / "build" / "interop" / "results.jsonl"
LAST: Final = 6


class Client(NamedTuple):
    """A client: its module, its environment (None: that of the project), and its arguments."""

    name: str
    module: str
    environment: str | None = None
    arguments: tuple[str, ...] = ()

    @property
    def is_real(self) -> bool:
        """Whether it is a program that others have written, and no script of ours."""
        return not self.arguments


CLIENTS: Final = (
    Client("mavutil", "mavutil_client"),
    Client("mavproxy", "mavproxy_client", "mavproxy"),
    Client("mavsdk", "mavsdk_client", "mavsdk"),
    Client("dronekit", "dronekit_client", "dronekit"),
    Client("qgroundcontrol", "shaped_client", None, ("qgroundcontrol",)),
    Client("mission_planner", "shaped_client", None, ("mission_planner",)),
    Client("mavros", "shaped_client", None, ("mavros",)),
)


class Scenario(NamedTuple):
    """What a client has reported: the results of its steps, and the rest of its output."""

    steps: list[dict[str, Any]]
    unfinished: str
    code: int
    output: list[str]

    @property
    def failures(self) -> list[str]:
        """Each step that has failed, with its reason."""
        found = [f"{one['step']}: {one['error']}" for one in self.steps if not one["passed"]]
        if self.unfinished:
            found.append(f"{self.unfinished}: the process ended in it: {self.output[-LAST:]}")
        if not found and self.code:
            found.append(f"exit code {self.code}: {self.output[-LAST:]}")
        return found


def run(client: Client, python: Path, robot: RobotOnAir, folder: Path) -> str:
    """Run a client with its Python against the robot; return its output."""
    words = [str(python), "-m", f"tests.interop.clients.{client.module}", *client.arguments]
    words += ["--port", str(robot.port), "--recording", str(robot.recording)]
    words += ["--folder", str(folder)]
    dialect = {"PYTHONPATH": str(ROOT), "MAVLINK20": "1", "MAVLINK_DIALECT": "all"}
    with subprocess.Popen(
        words,
        cwd=ROOT,
        env={**os.environ, **dialect},
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    ) as child:
        try:
            output, _ = child.communicate(timeout=SCENARIO_S)
        except subprocess.TimeoutExpired:
            child.kill()
            output, _ = child.communicate()
            output += f"\nthe scenario has not ended within {SCENARIO_S:g} s"
    return f"{output}\nexit code {child.returncode}"


def read(output: str) -> Scenario:
    """Return the results in the output of a client."""
    steps, others, begun = [], [], ""
    for line in output.splitlines():
        try:
            fields = json.loads(line) if line.startswith("{") else {}
        except ValueError:
            fields = {}
        if "begins" in fields:
            begun = fields["begins"]
        elif "step" in fields:
            begun = ""
            steps.append(fields)
        elif line.strip():
            others.append(line)
    code = int(others.pop().removeprefix("exit code "))
    return Scenario(steps, begun, code, others)


def keep(client: str, line: str, seed: int, output: str, scenario: Scenario) -> None:
    """Add a run to the results that the documentation has a table of, and keep its output."""
    RESULTS.parent.mkdir(parents=True, exist_ok=True)
    log = RESULTS.with_name(f"{client}-{line}-{seed}.log")
    log.write_text(output, encoding="utf-8")
    keys = ("step", "passed", "seconds")
    found = [{key: one[key] for key in keys} for one in scenario.steps]
    row = {"client": client, "line": line, "seed": seed, "steps": found}
    with RESULTS.open("a", encoding="utf-8") as file:
        file.write(json.dumps(row) + "\n")
