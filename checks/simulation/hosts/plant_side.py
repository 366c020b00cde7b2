"""The plant's process in the simulation: real world, robot link, requests and loop."""

from collections.abc import Callable
from typing import Any, Final

from checks.simulation.hosts.scheduler import Host, Scheduler
from checks.simulation.hosts.threads import SimulatedClock
from plant.model.configuration import Noise
from plant.process.loop import Process, RequestQueue, Wake
from plant.process.robot_link import RobotLink
from plant.process.run import watch_robots
from plant.sim.simulation import Plant
from protocol.bus.bus import Bus, claim, open_bus
from protocol.bus.network import Network
from protocol.topics import RUN, WORLD, Role
from protocol.world import GoalPose, Polygon, Start, World

WORLDS: Final = (
    World(
        name="plain",
        size_m=(60.0, 60.0),
        start=Start(x_m=30.0, y_m=30.0),
        goal=GoalPose(x_m=33.0, y_m=30.0),
        walls=False,
    ),
    World(
        name="room",
        size_m=(6.0, 4.0),
        start=Start(x_m=0.6, y_m=2.0),
        goal=GoalPose(x_m=5.0, y_m=2.0),
        obstacles=(Polygon(((2.6, 1.5), (3.4, 1.5), (3.4, 2.3), (2.6, 2.3))),),
    ),
)


class PlantSide:
    """A plant that can be killed and restarted, with a new time and place."""

    def __init__(
        self,
        scheduler: Scheduler,
        name: str,
        world: World,
        look: Callable[[Plant], None],
        started: Callable[[], None],
        *,
        lockstep: bool,
    ) -> None:
        self.name = name
        self.host = Host(scheduler, name)
        self.host.alive = False
        self.plant: Plant | None = None
        self.bus: Bus | None = None
        self.robot_link: RobotLink | None = None
        self.starts = 0
        self._scheduler = scheduler
        self._world = world
        self._look = look
        self._started = started
        self._lockstep = lockstep
        self._requests: RequestQueue | None = None
        self._wake = Wake()

    def start(self) -> None:
        """Start the process."""
        if self.host.alive:
            return
        self.host = Host(self._scheduler, self.name, 5_000_000_000 * (self.starts + 1))
        self.starts += 1
        self.host.spawn(self._main)

    def kill(self) -> None:
        """Kill the process."""
        if self.bus is not None and self.host.alive:
            self.host.alive = False
            session: Any = self.bus._session
            session.close()
            self.host.kill()
        self.plant = self.bus = None

    def _main(self) -> None:
        plant = Plant(self._world, self.starts, Noise())
        bus = self.bus = open_bus(Network(), Role.PLANT, "r1", self.host.now_ns)
        wake = self._wake = Wake()
        requests = self._requests = RequestQueue(running=True, world={}, nudge=wake)
        link = self.robot_link = RobotLink(bus, "r1", 0, wake, lockstep=self._lockstep)
        for service in (RUN, WORLD):
            bus.serve(service, lambda request: requests.ask(0, request), "r1")
        claim(bus, ["r1"])
        self.plant = plant
        self._started()
        process = Process(plant, [link], requests, wake, look=lambda: self._look(plant))
        if self._lockstep:
            watch_robots(bus, [link], wake)
            process.run_lockstep(speed=1.0)
        else:
            process.run_wall(SimulatedClock())

    def stand(self, *, still: bool) -> None:
        """Let the plant's clock stand still or go on, as an operator's request does."""
        if self._requests is not None:
            self._requests.running = not still
            self.host.call(self._wake)
