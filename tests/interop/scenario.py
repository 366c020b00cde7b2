"""Run the scenario of a client as a process, and read the results of its steps."""

import json
import os
import subprocess
from pathlib import Path
from typing import Any, Final, NamedTuple

from checks.built import ROOT
from tests.interop.clients.steps import STEPS
from tests.interop.environments import Installed
from tests.interop.vehicle import RobotOnAir

SCENARIO_S: Final = 270.0
"""Less than what faulthandler leaves a test."""
RESULTS: Final = ROOT / "build" / "interop" / "results.jsonl"
LAST: Final = 6


class Client(NamedTuple):
    """A client: its module, its environment (None: that of the project), and its arguments.

    `steps` are those of the scenario that it can do. One that `listens` sends no heartbeat: by UDP
    it waits for the robot's first message. One that `hangs` waits for a lost frame without end, and
    is not tried on a line that loses frames.
    """

    name: str
    module: str
    environment: str | None = None
    arguments: tuple[str, ...] = ()
    steps: tuple[str, ...] = STEPS
    listens: bool = False
    hangs: bool = False

    @property
    def is_real(self) -> bool:
        """Whether it is a program that others have written, and no script of ours."""
        return not self.arguments


def without(*names: str) -> tuple[str, ...]:
    """Return the steps without those that a client has no calls for."""
    return tuple(step for step in STEPS if step not in names)


CONFIGURED: Final = ("connect", "parameters", "set_parameter", "log")
"""The Methodic Configurator sets a vehicle up, and does not drive it."""
CLIENTS: Final = (
    Client("mavutil", "mavutil_client"),
    Client("mavproxy", "mavproxy_client", "mavproxy"),
    Client("mavsdk", "mavsdk_client", "mavsdk"),
    Client("dronekit", "dronekit_client", "dronekit"),
    Client("dronekit2", "dronekit_client", "dronekit2"),
    Client("mavkit", "mavkit_client", "mavkit", steps=without("log"), listens=True, hangs=True),
    Client("node_mavlink", "node_client", "node_mavlink"),
    Client("configurator", "configurator_client", "configurator", steps=CONFIGURED, listens=True),
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


def run(client: Client, program: Installed, robot: RobotOnAir, folder: Path) -> str:
    """Run a client against the robot; return its output."""
    words = [str(program.python), "-m", f"tests.interop.clients.{client.module}", *client.arguments]
    words += ["--port", str(robot.port), "--recording", str(robot.recording)]
    words += ["--folder", str(folder), "--transport", robot.transport]
    dialect = {"PYTHONPATH": str(ROOT), "MAVLINK20": "1", "MAVLINK_DIALECT": "all"}
    with subprocess.Popen(
        words,
        cwd=ROOT,
        env={**os.environ, **dialect, **program.variables},
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


def keep(client: Client, line: str, seed: int, output: str, scenario: Scenario) -> None:
    """Add a run to the results that the documentation has a table of, and keep its output.

    A step that was not reached has failed.
    """
    RESULTS.parent.mkdir(parents=True, exist_ok=True)
    log = RESULTS.with_name(f"{client.name}-{line}-{seed}.log")
    log.write_text(output, encoding="utf-8")
    keys = ("step", "passed", "seconds")
    found = {step: {"step": step, "passed": False, "seconds": 0} for step in client.steps}
    found |= {one["step"]: {key: one[key] for key in keys} for one in scenario.steps}
    row = {"client": client.name, "line": line, "seed": seed, "steps": list(found.values())}
    with RESULTS.open("a", encoding="utf-8") as file:
        file.write(json.dumps(row) + "\n")
