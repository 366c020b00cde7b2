"""Plant and robot as processes in lockstep over Zenoh, driven to a goal from this process."""

from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from itertools import count
from queue import Empty, SimpleQueue
from time import monotonic_ns, perf_counter
from typing import NamedTuple

from checks.harness.bus_calls import arm_request, ask_until_accepted, auto_goal_request
from checks.harness.processes import ROBOT, free_port, sidestep
from protocol.bus.bus import Bus, open_bus
from protocol.bus.network import Network
from protocol.outcome import start_arguments
from protocol.topics import COMMAND, RUN, STATUS, Role, Service
from protocol.wire.codec import decode
from protocol.wire.enums import GoalState, RunAction
from protocol.wire.message import Message
from protocol.wire.messages import NavigatorStatus, RunRequest, RunScore
from protocol.world import World
from robot.core.parameters import DEFAULTS
from runtime.config import totals_arguments
from study.trial.trial import Trial, params_of, wire_goal_of

ACCEPTED_S = 100.0
STATUS_S = 60.0


class Run(NamedTuple):
    """A run to the end of its goal: the plant's score, and the wall time it took."""

    score: RunScore
    wall_s: float

    @property
    def digest(self) -> str:
        """The digest of the true trajectory, in hexadecimal."""
        return bytes(self.score.digest).hex()

    @property
    def pace(self) -> float:
        """Simulated time over wall time."""
        return self.score.ticks * 0.05 / self.wall_s


def lockstep_run(file: str, trial: Trial, *, router: bool = False) -> Run:
    """Run a trial over the bus instead of in one process; `file` names the file of its world."""
    with stack(file, trial, router=router) as processes:
        return GoalDriver(processes.bus).drive(trial.world)


class Processes(NamedTuple):
    """The running processes of a trial: a bus to them, and their ids by role."""

    bus: Bus
    pids: dict[str, int]


@contextmanager
def stack(
    file: str,
    trial: Trial,
    *,
    router: bool,
    program: Callable[[str], tuple[str, ...]] = lambda _: ("sidestep",),
) -> Iterator[Processes]:
    """Run the processes of a trial and open a bus to them.

    `program` returns the Python module that runs the verb of a role, with its first arguments.
    """
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    with ExitStack() as processes:
        if router:
            processes.enter_context(
                sidestep("run", "router", "--listen", endpoint, ready="router at")
            )
        dials = "--connect" if router else "--listen"
        robot = processes.enter_context(
            sidestep(*robot_words(trial), dials, endpoint, ready="ready", program=program("robot"))
        )
        words = (*plant_words(file, trial), "--connect", endpoint)
        plant = processes.enter_context(sidestep(*words, ready="plant:", program=program("plant")))
        network = Network(mode="client", connect=(endpoint,))
        bus = processes.enter_context(open_bus(network, Role.GROUND, ROBOT))
        yield Processes(bus, {"plant": plant.pid, "robot": robot.pid})


def robot_words(trial: Trial) -> Iterator[str]:
    """Yield the command line of a robot with the start and parameters of a trial."""
    start = trial.world.start
    yield from ("robot", "--id", ROBOT, "--lockstep")
    yield from ("--start", *start_arguments(start.x_m, start.y_m, start.heading_rad))
    yield from totals_arguments(trial.world.robot)
    params = params_of(trial)
    for name in params._fields:
        value = getattr(params, name)
        if value != getattr(DEFAULTS, name):
            yield from ("--param", f"{name}={value!r}")


def plant_words(file: str, trial: Trial) -> Iterator[str]:
    """Yield the command line of a plant with the world, seed and noise of a trial."""
    yield from ("plant", "--world", file, "--robots", ROBOT, "--lockstep", "--paused")
    yield from ("--seed", str(trial.seed))
    if trial.noise is not None:
        yield from ("--noise", trial.noise)


class GoalDriver:
    """Sends the goal between tick 0 and tick 1, and waits for its end."""

    def __init__(self, bus: Bus) -> None:
        self._bus = bus
        self._requests = count(monotonic_ns())
        self._frames: SimpleQueue[bytes] = SimpleQueue()
        bus.stream(STATUS, lambda _key, frame, _ns: self._frames.put(frame))

    def drive(self, world: World, started: Callable[[], None] = lambda: None) -> Run:
        """Drive to the goal of a world and return its score; call `started` at its beginning."""
        goal = wire_goal_of(world)
        self._ask(COMMAND, arm_request)
        self._ask(COMMAND, lambda number: auto_goal_request(number, goal))
        begun_s = perf_counter()
        self._ask(RUN, lambda _: RunRequest(action=RunAction.START, until_ns=0))
        started()
        ended_ns = self._end_of_goal()
        wall_s = perf_counter() - begun_s
        score = self._bus.ask(RUN, RunRequest(action=RunAction.SCORE, until_ns=ended_ns), 2.0)
        if not isinstance(score, RunScore):
            raise RuntimeError(f"the plant returned no score: {score!r}")
        return Run(score, wall_s)

    def _end_of_goal(self) -> int:
        while True:
            try:
                status = decode(self._frames.get(timeout=STATUS_S)).message
            except Empty:
                raise RuntimeError(f"no status from the robot for {STATUS_S:g} s") from None
            if isinstance(status, NavigatorStatus) and status.goal >= GoalState.REACHED:
                return status.goal_ended_ns

    def _ask(self, service: Service, request: Callable[[int], Message]) -> None:
        """Repeat a request until it is accepted: the processes need a moment to connect."""
        ask_until_accepted(
            self._bus, service, lambda: request(next(self._requests)), ROBOT, ACCEPTED_S
        )
