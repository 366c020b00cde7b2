"""Connect a plant to the bus and run it until it is stopped."""

import signal
import sys
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial

from plant.placement.shortest_path import known_length_m
from plant.process.loop import Process, Wake, nothing
from plant.process.requests import RequestQueue
from plant.process.robot_link import RobotLink
from plant.sim.simulation import Plant
from plant.world.to_json import as_json, run_json
from protocol.bus.bus import Bus, open_bus
from protocol.bus.claim import claim
from protocol.bus.network import Network
from protocol.bus.presence import Presence
from protocol.topics import RUN, WORLD, Role
from runtime.clock import WallClock
from runtime.watchdog import Watchdog


def run(
    plant: Plant, network: Network, robots: list[str], *, lockstep: bool, speed: float, paused: bool
) -> int:
    """Run until stopped and return 0. In lockstep the first tick waits for the robots."""
    wake = Wake()
    with open_bus(replace(network, patient=lockstep), Role.PLANT, robots[0]) as bus:
        for number in (
            signal.SIGINT,
            signal.SIGTERM,
        ):
            signal.signal(number, lambda *_: wake.stop())
        bus.on_impostor(lambda why: log_line(f"plant: {why}"))
        watchdog = Watchdog()
        process = assemble(
            plant, bus, robots, wake, lockstep=lockstep, paused=paused, turn=watchdog.reset
        )
        names = ", ".join(robots)
        log_line(f"plant: world {plant.world.name} with {names}")
        with watchdog:
            if lockstep:
                process.run_lockstep(speed)
            else:
                process.run_wall(WallClock())
    log_line("plant: ends")
    return 0


def assemble(
    plant: Plant,
    bus: Bus,
    robots: list[str],
    wake: Wake,
    *,
    lockstep: bool,
    paused: bool,
    turn: Callable[[], None] = nothing,
) -> Process:
    """Create the links to the robots and the services, and announce them. Raises NameTakenError."""
    world = as_json(plant.world, known_length_m(plant.world))
    world |= run_json(plant.world, plant.seed, plant.noise)
    desk = RequestQueue(running=not paused, world=world, nudge=wake)
    wires = [
        RobotLink(bus, robot, number, wake, lockstep=lockstep)
        for number, robot in enumerate(robots)
    ]
    for number, robot in enumerate(robots):
        take = partial(desk.ask, number)
        bus.serve(RUN, take, robot)
        bus.serve(WORLD, take, robot)
    claim(bus, robots)
    if lockstep:
        watch_robots(bus, wires, wake)
    look = RejectLog(lambda: bus.rejected, log_line).look
    return Process(plant, wires, desk, wake, look=look, turn=turn)


def watch_robots(bus: Bus, links: list[RobotLink], wake: Wake) -> None:
    """Tell each link which robots are present, so that no tick waits for one that has gone."""

    def note(token: Presence, appeared: bool) -> None:
        for link in links:
            link.note_presence(token, appeared)
        wake()

    bus.watch(note)


def log_line(line: str) -> None:
    """Print a line to standard error."""
    print(line, file=sys.stderr, flush=True)


class RejectLog:
    """Report rejected frames at once, and again whenever their number has doubled.

    `counts` returns the numbers of rejected frames by path; `report` receives each line.
    """

    def __init__(
        self, counts: Callable[[], Mapping[str, int]], report: Callable[[str], None]
    ) -> None:
        self._counts = counts
        self._report = report
        self._reported: dict[str, int] = {}

    def look(self) -> None:
        """Report the counts that have grown."""
        for path, count in self._counts().items():
            if count > 2 * self._reported.get(path, 0):
                self._reported[path] = count
                what = f"{count} rejected on {path}"
                self._report(f"plant: {what}: find out which other process publishes there")
