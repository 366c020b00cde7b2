"""Puts a plant on the bus and runs it until told to stop."""

import signal
import sys
from collections.abc import Callable, Mapping
from functools import partial

from plant.placement.shortest_path import known_length_m
from plant.process.loop import Process, Wake, nothing
from plant.process.requests import RequestQueue
from plant.process.robot_link import RobotLink
from plant.sim.simulation import Plant
from plant.world.to_json import as_json
from protocol.bus.bus import Bus, open_bus
from protocol.bus.claim import claim
from protocol.bus.network import Network
from protocol.topics import RUN, WORLD, Role
from runtime.clock import WallClock
from runtime.watchdog import Watchdog


def run(
    plant: Plant, network: Network, robots: list[str], *, lockstep: bool, speed: float, paused: bool
) -> int:
    """0 when told to stop. In lockstep the first senses wait until the robots listen."""
    wake = Wake()
    with open_bus(network, Role.PLANT, robots[0]) as bus:
        for number in (signal.SIGINT, signal.SIGTERM):  # while dialling, they end it as ever
            signal.signal(number, lambda *_: wake.stop())
        bus.on_impostor(lambda why: tell(f"plant: {why}"))
        watchdog = Watchdog()
        process = assemble(
            plant, bus, robots, wake, lockstep=lockstep, paused=paused, turn=watchdog.reset
        )
        names = ", ".join(robots)
        tell(f"plant: world {plant.world.name} with {names}")
        with watchdog:
            if lockstep:
                process.run_lockstep(speed)
            else:
                process.run_wall(WallClock())
    tell("plant: ends")
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
    """The wires to each robot, the services, and the announcement. Raises NameTakenError."""
    world = as_json(plant.world, known_length_m(plant.world))
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
    look = RejectLog(lambda: bus.rejected, tell).look
    return Process(plant, wires, desk, wake, look=look, turn=turn)


def tell(line: str) -> None:
    print(line, file=sys.stderr, flush=True)


class RejectLog:
    """Reports rejected frames at once, and whenever their number has doubled.

    `counts` returns how many frames were rejected, by path; `tell` gets a line.
    """

    def __init__(self, counts: Callable[[], Mapping[str, int]], tell: Callable[[str], None]):
        self._counts = counts
        self._tell = tell
        self._told: dict[str, int] = {}

    def look(self) -> None:
        for path, count in self._counts().items():
            if count > 2 * self._told.get(path, 0):
                self._told[path] = count
                what = f"{count} unreadable or refused on {path}"
                self._tell(f"plant: {what}: find out which other process publishes there")
