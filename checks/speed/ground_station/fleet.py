"""CPU time of the app and missed ticks of the robots, with a whole fleet that is driving."""

import argparse
import os
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from threading import Event, Thread
from time import monotonic_ns
from typing import Final

from checks.endurance.fleet import GoalSender, RobotTelemetry
from checks.harness.figures import Figure
from checks.harness.terminal import Terminal
from checks.harness.until import until
from checks.speed.ground_station.stage import SIZES
from ground.cli.main import parse
from ground.cli.run.up import free_endpoint
from ground.launch.child_command import command
from ground.launch.child_processes import Children
from ground.launch.scenario import process_arguments, scenario_of, world_facts, world_query
from protocol.bus.bus import Bus, open_bus
from protocol.bus.network import Network
from protocol.topics import CYCLE, ODOMETRY, SONAR, STATUS, Role
from runtime.clock import WallClock

WORLD: Final = "open"
CPU_AT_MOST: Final = 25.0
DRAWN: Final = "pose"
"""A word that is on the screen before many lines of the log hide that the app is ready."""
LISTENS_S: Final = 30.0
PATIENCE_S: Final = 60.0
POLL_S: Final = 0.05


class DrivingFleet:
    """Robots that keep driving; `missed` counts their missed ticks."""

    def __init__(self, endpoint: str, robots: tuple[str, ...], bus: Bus) -> None:
        self.endpoint, self.robots = endpoint, robots
        self._telemetry = {robot: RobotTelemetry(monotonic_ns()) for robot in robots}
        for robot, telemetry in self._telemetry.items():
            for topic in (CYCLE, STATUS, ODOMETRY, SONAR):
                bus.stream(topic, telemetry.record, robot)
        self._senders = [GoalSender(bus, robot) for robot in robots]

    def is_complete(self) -> bool:
        """Return whether every robot has been received."""
        return all(one.pose is not None and one.ticks for one in self._telemetry.values())

    def keep_driving(self, over: Event) -> None:
        """Send goals until `over` is set."""
        while not over.wait(POLL_S):
            for sender in self._senders:
                sender.poll(self._telemetry[sender.robot], monotonic_ns())

    def ticks(self) -> tuple[int, int]:
        """Return the ticks so far, and those that were missed."""
        ticks = [missed for one in self._telemetry.values() for _, missed in one.ticks]
        return len(ticks), sum(ticks)


@contextmanager
def driving_fleet(robots: int, folder: Path) -> Iterator[DrivingFleet]:
    """Start a router, robots and their plant as `up` does in wall time, and keep them driving."""
    words = ["up", "--headless", "--clock", "wall", "--world", WORLD, "--robots", str(robots)]
    options = parse([*words, "--router", "--no-record"])
    scenario = scenario_of(options, world_facts(command(world_query(options), os.getpid())))
    endpoint, over = free_endpoint(), Event()
    with ExitStack() as scope:
        children = scope.enter_context(Children(WallClock()))
        for role, arguments in process_arguments(scenario, endpoint):
            children.start(role, arguments)
        network = Network(mode="client", connect=(endpoint,), connect_timeout_s=LISTENS_S)
        bus = scope.enter_context(open_bus(network, Role.GROUND, "r1"))
        fleet = DrivingFleet(endpoint, scenario.robots, bus)
        until(fleet.is_complete, "telemetry of every robot", within_s=PATIENCE_S)
        thread = Thread(target=fleet.keep_driving, args=(over,), daemon=True)
        thread.start()
        try:
            yield fleet
        finally:
            over.set()
            thread.join()


def fleet_figures(options: argparse.Namespace) -> tuple[list[Figure], list[str]]:
    """Measure CPU share, output and missed ticks, without the app and with it."""
    with TemporaryDirectory() as folder, driving_fleet(options.robots, Path(folder)) as fleet:
        Event().wait(options.settle)
        alone = missed_in(fleet, options.seconds)
        words = ("ground", "--id", "r1", "--connect", fleet.endpoint)
        with Terminal(words, SIZES[0], {"XDG_STATE_HOME": folder}) as terminal:
            terminal.shown(DRAWN, PATIENCE_S)
            Event().wait(options.settle)
            before = fleet.ticks()
            spent = [terminal.spent(options.seconds) for _ in range(options.repetitions)]
            after = fleet.ticks()
    shares = tuple(one.cpu_percent for one in spent)
    name = f"{options.robots} robots, 80x24"
    figures = [
        Figure(name=f"CPU of one core, {name}", unit="%", values=shares, at_most=CPU_AT_MOST),
        Figure(name=f"written, {name}", unit="kB/s", values=tuple(one.kb_per_s for one in spent)),
        Figure(
            name=f"ticks missed with the app, {name}",
            unit="ticks",
            values=(float(after[1] - before[1]),),
        ),
        Figure(name=f"ticks missed before it, {name}", unit="ticks", values=(float(alone),)),
    ]
    return figures, [
        f"fleet: {options.robots} robots at 20 Hz in {WORLD}, all driving, in wall time;"
        f" {after[0] - before[0]} ticks with the app"
    ]


def missed_in(fleet: DrivingFleet, seconds: float) -> int:
    """Return the ticks that were missed in the next so many seconds."""
    before = fleet.ticks()[1]
    Event().wait(seconds)
    return fleet.ticks()[1] - before
