"""The processes of robot and plant in the simulation, with their real loops, links and buses."""

from collections.abc import Callable, Iterable, Iterator
from typing import Any, Final, Protocol

from checks.simulation.hosts.substitutes import DISKS, STATE, SimulatedDisk
from checks.simulation.hosts.virtual_time import Host, Scheduler, SimulatedClock, current_task
from plant.model.configuration import Noise
from plant.process import Process, RequestQueue, Wake, watch_processes
from plant.robot_link import PlantLink
from plant.sim.simulation import Plant
from protocol.bus.bus import Bus, claim, open_bus
from protocol.bus.network import Network
from protocol.topics import RUN, WORLD, Role
from protocol.wire.message import Message
from protocol.world import GoalPose, Start, World, WorldPolygon
from robot import run as robot_run
from robot.core.parameters import DEFAULTS, Params
from robot.core.values import Pose
from robot.file_writer import WriterThread
from robot.process import RobotProcess
from robot.storage import Store
from robot.vehicle import Answer, RobotVehicle
from runtime.clock import Clock, Tick

SETTLES_NS: Final = 300_000_000
"""After a hang the tick grid has recovered its phase within this time."""


RESTARTED_NS: Final = 1_000_000_000
"""After a restart the robot serves again within this time."""


class RobotObserver(Protocol):
    """Receives the events of the robot process."""

    def robot_started(self) -> None:
        """Receive the start of the process."""

    def received(
        self, vehicle: RobotVehicle, request: Message, answer: Answer, operator: str
    ) -> None:
        """Receive a request and its answer."""

    def restored(self, vehicle: RobotVehicle) -> None:
        """Receive the vehicle with its restored files."""

    def cycled(self, side: "RobotSide", tick: Tick) -> None:
        """Receive the end of a tick."""

    def held_up(self, until_ns: int) -> None:
        """Receive the time until which the process is delayed."""


class ObservedVehicle(RobotVehicle):
    """The real vehicle, whose requests and answers are passed to an observer."""

    observer: RobotObserver

    def receive(self, request: Message, now_ns: int, operator: str = "", **more: Any) -> Answer:
        """Act on a request, and pass it and its answer to the observer."""
        answer = super().receive(request, now_ns, operator, **more)
        self.observer.received(self, request, answer, operator)
        return answer


class NoWatchdog:
    """Replaces runtime.watchdog.Watchdog: the simulation ends a robot that hangs by itself."""

    def reset(self) -> None:
        """Do nothing."""

    def reset_by(self, grid: Iterator[Tick]) -> Iterator[Tick]:
        """Return the grid."""
        return grid


class RobotSide:
    """A robot that can be killed and restarted; its disk is kept."""

    def __init__(
        self,
        scheduler: Scheduler,
        name: str,
        params: Params,
        start: Pose,
        observer: RobotObserver,
        *,
        lockstep: bool,
    ) -> None:
        self.name = name
        self.robot = "r1"
        self.disk = DISKS[name] = SimulatedDisk()
        self.clock_offset_ns = 0
        self.wall_step_ns = 0
        self.starts = 0
        self.died_ns = 0
        self.ticks = 0
        self.hang_ns = 0
        self.late_ns = 0
        self.stage_cost_ns = 100_000
        self.params = params
        self.vehicle: ObservedVehicle | None = None
        self.process: RobotProcess | None = None
        self.bus: Bus | None = None
        self.host = Host(scheduler, name)
        self.host.alive = False
        self.clock: Clock | None = None
        """The clock of its loop."""
        self.lockstep = lockstep
        self._scheduler = scheduler
        self._start = start
        self._observer = observer

    @property
    def runs(self) -> bool:
        """True if its loop runs."""
        return self.host.alive and self.vehicle is not None

    def start(self) -> None:
        """Start the process."""
        if self.host.alive:
            return
        self.host = Host(self._scheduler, self.name, self.clock_offset_ns)
        self.host.wall_offset_ns += self.wall_step_ns
        self.starts += 1
        self.host.spawn(self._main)

    def kill(self) -> None:
        """Kill the process."""
        if self.bus is not None and self.host.alive:
            self.died_ns = self._scheduler.now_ns
            self.host.alive = False
            session: Any = self.bus._session
            session.close()
            self.host.kill()
        self.vehicle = self.process = self.bus = None

    def _main(self) -> None:
        store = Store(STATE, WriterThread())
        params, warnings = store.load(self.params, self.params)
        vehicle = ObservedVehicle(params, store, self._start, self.params)
        vehicle.observer = self._observer
        for warning in warnings:
            vehicle.announce(4, warning)
        bus = self.bus = open_bus(Network(), Role.ROBOT, self.robot, self.host.now_ns)
        claim(bus, [self.robot])
        if self.lockstep:
            watchdog: Any = NoWatchdog()
            process, run_loop = robot_run.in_lockstep(vehicle, bus, watchdog)
            self._begin(vehicle, process)
            self._observe_cycles(process)
            run_loop()
        else:
            process, grid = robot_run.in_wall_time(vehicle, bus, robot_run.epoch())
            self._begin(vehicle, process)
            process.run(self._observed(grid))
        process.finish()
        self._scheduler.at(self._scheduler.now_ns, self._restart)

    def _restart(self) -> None:
        """Start a process that has ended on request again, as its supervisor does."""
        self._observer.held_up(self._scheduler.now_ns + RESTARTED_NS)
        self.kill()
        self._observer.robot_started()
        self.start()

    def _begin(self, vehicle: ObservedVehicle, process: RobotProcess) -> None:
        self._observer.restored(vehicle)
        self.clock = process._clock
        self.vehicle, self.process = vehicle, process

    def _observe_cycles(self, process: Any) -> None:
        """Call the observer after each cycle, which the thread of the bus runs."""
        cycle = process.cycle

        def observed(tick: Tick) -> None:
            cycle(tick)
            self.ticks += 1
            self._observer.cycled(self, tick)

        process.cycle = observed

    def _observed(self, grid: Iterable[Tick]) -> Iterator[Tick]:
        """Yield the ticks of the grid, call the observer after each, and delay for faults."""
        task = current_task()
        for tick in grid:
            clock: Any = self.clock
            clock.stage_cost_ns = self.stage_cost_ns
            yield tick
            self.ticks += 1
            self._observer.cycled(self, tick)
            busy_ns, self.hang_ns = self.hang_ns + self.late_ns, 0
            if busy_ns:
                self._observer.held_up(self._scheduler.now_ns + busy_ns + SETTLES_NS)
                task.wait_until(self._scheduler.now_ns + busy_ns)


def robot_params(navigator: int) -> Params:
    """Return the default parameters with a navigator."""
    return DEFAULTS._replace(navigator=navigator)


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
        obstacles=(WorldPolygon(((2.6, 1.5), (3.4, 1.5), (3.4, 2.3), (2.6, 2.3))),),
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
        self.robot_link: PlantLink | None = None
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
        link = self.robot_link = PlantLink(bus, "r1", 0, wake, lockstep=self._lockstep)
        for service in (RUN, WORLD):
            bus.serve(service, lambda request: requests.ask(0, request), "r1")
        claim(bus, ["r1"])
        self.plant = plant
        self._started()
        process = Process(plant, [link], requests, wake, look=lambda: self._look(plant))
        if self._lockstep:
            watch_processes(bus, [link], None, wake)
            process.run_lockstep(speed=1.0)
        else:
            process.run_wall(SimulatedClock())

    def stand(self, *, still: bool) -> None:
        """Let the plant's clock stand still or go on, as an operator's request does."""
        if self._requests is not None:
            self._requests.running = not still
            self.host.call(self._wake)
