"""Provide worlds and faults without a plant, and a stack without processes."""

import argparse
from collections.abc import Callable
from typing import Any, TypeVar

from ground.app.app import GroundApp
from ground.app.appearance import Appearance
from ground.launch.launcher import Stack
from ground.launch.scenario import Scenario
from runtime.clock import ManualClock
from tests.support.tui.fakes import FakeCommandSink, FakeStation
from tests.support.tui.pilot import Stage
from tests.support.tui.underway import driving

T = TypeVar("T")
WORLD: dict[str, Any] = {
    "name": "box",
    "size_m": [6.0, 4.0],
    "start": {"x_m": 0.6, "y_m": 2.0, "heading_deg": 0.0},
    "goal": {"x_m": 5.4, "y_m": 2.0, "heading_deg": 0.0},
    "obstacles": [
        {"polygon_m": [[2.5, 1.6], [3.3, 1.6], [3.3, 2.4], [2.5, 2.4]]},
        {
            "circle_m": {"x": 4.5, "y": 3.0, "radius": 0.15},
            "path_m": [[4.5, 3.0], [4.5, 1.0]],
            "speed_m_s": 0.1,
        },
    ],
    "faults": [],
    "shortest_path_m": 5.0,
}
FAULTS = {
    "faults": [
        {"kind": "sonar_frozen", "targets": ["0", "1", "all"], "unit": "", "says": "repeats"},
        {"kind": "ticks_stopped", "targets": [""], "unit": "", "says": "no ticks"},
    ]
}


class FakeStack(Stack):
    """Starts no processes and records its calls."""

    def __init__(self) -> None:
        super().__init__(argparse.Namespace(), self.scenario_of("box"), "", ManualClock())
        self.begun: list[str] = []
        self.driven: list[str] = []
        self.done: list[tuple[str, str]] = []

    def scenario_of(self, world: str) -> Scenario:
        return Scenario(
            world=world, name=world, facts={}, scenario_robots=(), navigator="vgm", side="left",
            seed=0, noise=None, speed="1", router=False, record=None, timeout_s=1.0,
        )  # fmt: skip

    def roles(self) -> list[str]:
        return ["robot r1", "plant"]

    def check(self) -> None:
        """Report no problems."""

    def restarted(self, scenario: Scenario, stopped: Callable[[], None] = lambda: None) -> None:
        stopped()
        self.scenario = scenario
        self.begun.append(scenario.name)

    def drive_to_goals(self) -> list[str]:
        self.driven.append(self.scenario.name)
        return []

    def scenario_in(self, world: str, faults: Any = ()) -> Scenario:
        return self.scenario_of(" ".join([world, *(str(fault["kind"]) for fault in faults)]))

    def inject_fault(self, role: str, what: str) -> str:
        self.done.append((role, what))
        return f"{what} {role}"


class SynchronousApp(GroundApp):
    """Runs background jobs at once."""

    def run_in_background(self, job: Callable[[], T], done: Callable[[T], None]) -> None:
        done(job())


async def on(screen: str, stack: Stack | None, story: Callable[[Stage], Any]) -> None:
    station, commands = driving(FakeStation()), FakeCommandSink()
    app = SynchronousApp(station, commands, appearance=Appearance(hz=0.0), stack=stack)
    async with app.run_test(size=(100, 28)) as pilot:
        stage = Stage(app, pilot, station, commands)
        await stage.press(screen)
        await stage.redraw()
        await story(stage)
