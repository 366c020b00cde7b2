"""Plant and robot as processes in lockstep over Zenoh, this one as their ground; hub or router."""

from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from itertools import count
from queue import Empty, SimpleQueue
from time import monotonic_ns, perf_counter
from typing import NamedTuple

from plant.model.types import World
from protocol.bus.bus import Bus, open_bus
from protocol.bus.network import Network
from protocol.topics import COMMAND, RUN, STATUS, Role, Service
from protocol.wire.codec import decode
from protocol.wire.enums import AckResult, Command, GoalState, Mode, RunAction
from protocol.wire.goal import start_words
from protocol.wire.message import Message
from protocol.wire.messages import (
    CommandAck,
    CommandRequest,
    GoalRequest,
    NavigatorStatus,
    RunRequest,
    RunScore,
)
from robot.core.parameters import DEFAULTS
from runtime.errors import NoAnswer
from study.trial.trial import Trial, params_of, wire_goal_of
from verification.harness.processes import free_port, sidestep

ROBOT = "r1"
ATTEMPTS = 200
PATIENCE_S = 60.0


class Run(NamedTuple):
    """One run to the end of its goal: what the plant scored, and how long it took this machine."""

    score: RunScore
    wall_s: float

    @property
    def digest(self) -> str:
        return bytes(self.score.digest).hex()

    @property
    def pace(self) -> float:
        """x real time."""
        return self.score.ticks * 0.05 / self.wall_s


def lockstep_run(file: str, trial: Trial, *, router: bool = False) -> Run:
    """Do over the bus what the trial does in one process; `file` is where its world was from."""
    with stack(file, trial, router=router) as bus:
        return Ground(bus).drive(trial.world)


@contextmanager
def stack(file: str, trial: Trial, *, router: bool) -> Iterator[Bus]:
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    with ExitStack() as processes:
        if router:
            processes.enter_context(sidestep("router", "--listen", endpoint, ready="router at"))
        dials = "--connect" if router else "--listen"
        processes.enter_context(sidestep(*robot_words(trial), dials, endpoint, ready="ready"))
        plant = (*plant_words(file, trial), "--connect", endpoint)
        processes.enter_context(sidestep(*plant, ready="plant:"))
        network = Network(mode="client", connect=(endpoint,))
        yield processes.enter_context(open_bus(network, Role.GROUND, ROBOT))


def robot_words(trial: Trial) -> Iterator[str]:
    """The robot process with the start and the parameters that the trial gives its core."""
    start = trial.world.start
    yield from ("robot", "--id", ROBOT, "--lockstep")
    yield from ("--start", *start_words(start.x_m, start.y_m, start.heading_rad))
    params = params_of(trial)
    for name in params._fields:
        value = getattr(params, name)
        if value != getattr(DEFAULTS, name):
            yield from ("--param", f"{name}={value!r}")


def plant_words(file: str, trial: Trial) -> Iterator[str]:
    yield from ("plant", "--world", file, "--robots", ROBOT, "--lockstep", "--paused")
    yield from ("--seed", str(trial.seed))
    if trial.noise is not None:
        yield from ("--noise", trial.noise)


class Ground:
    """Gives the goal between tick 0 and tick 1, and waits for its end."""

    def __init__(self, bus: Bus) -> None:
        self._bus = bus
        self._requests = count(monotonic_ns())
        self._frames: SimpleQueue[bytes] = SimpleQueue()
        bus.stream(STATUS, lambda _key, frame, _ns: self._frames.put(frame))

    def drive(self, world: World) -> Run:
        arm = Command.COMPONENT_ARM_DISARM
        self._until_accepted(
            COMMAND, lambda n: CommandRequest(request_id=n, param1=1.0, param2=0.0, command=arm)
        )
        goal = wire_goal_of(world)._asdict()
        self._until_accepted(COMMAND, lambda n: GoalRequest(request_id=n, mode=Mode.AUTO, **goal))
        begun_s = perf_counter()
        start = RunRequest(action=RunAction.START, until_ns=0)
        self._until_accepted(RUN, lambda _: start)
        ended_ns = self._end_of_goal()
        wall_s = perf_counter() - begun_s
        score = self._bus.ask(RUN, RunRequest(action=RunAction.SCORE, until_ns=ended_ns), 2.0)
        if not isinstance(score, RunScore):
            raise RuntimeError(f"the plant gives no score: {score!r}")
        return Run(score, wall_s)

    def _end_of_goal(self) -> int:
        while True:
            try:
                status = decode(self._frames.get(timeout=PATIENCE_S)).message
            except Empty:
                raise RuntimeError("the robot says nothing any more") from None
            if isinstance(status, NavigatorStatus) and status.goal >= GoalState.REACHED:
                return status.goal_ended_ns

    def _until_accepted(self, service: Service, request: Callable[[int], Message]) -> None:
        """Both processes need a moment to find each other; each attempt waits for an answer."""
        answer: object = None
        for _ in range(ATTEMPTS):
            try:
                answer = self._bus.ask(service, request(next(self._requests)), 0.5)
            except NoAnswer as error:
                answer = error
            if isinstance(answer, CommandAck) and answer.result == AckResult.ACCEPTED:
                return
        raise RuntimeError(f"{service.path}: {answer!r}")
