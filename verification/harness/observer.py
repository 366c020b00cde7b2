"""Robot and plant as real processes, and an observer on their bus that keeps the robot driving."""

from collections import deque
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from itertools import count, cycle
from math import hypot
from pathlib import Path
from tempfile import TemporaryDirectory
from time import monotonic, monotonic_ns
from typing import Any, Final

from plant.model.types import World
from plant.world.file import load
from protocol.bus.bus import Bus, open_bus
from protocol.bus.network import Network, Tls
from protocol.topics import COMMAND, DRIVE, RUN, STATUS, TRUTH, Role, Service, Topic
from protocol.wire.codec import decode
from protocol.wire.enums import AckResult, Command, GoalState, Mode, RunAction
from protocol.wire.goal import start_words, wire_goal
from protocol.wire.message import Message
from protocol.wire.messages import (
    CommandAck,
    CommandRequest,
    GoalRequest,
    GroundTruth,
    NavigatorStatus,
    RunRequest,
    WheelCommand,
)
from runtime.errors import NoAnswer
from verification.harness.processes import free_port, sidestep
from verification.harness.until import until

PATIENCE_S: Final = 30.0
KEPT: Final = 2000
ROBOT: Final = "r1"


class Observer:
    """Statuses, wheel commands and truth, each with the time of its arrival."""

    def __init__(self, bus: Bus, world: World, endpoint: str, folder: Path) -> None:
        """`folder` is where programs may leave what they leave at a user's home."""
        self.bus, self.world, self.endpoint, self.folder = bus, world, endpoint, folder
        self.robot = ROBOT
        self.pid = 0
        """Of the robot's process."""
        self.statuses: deque[tuple[NavigatorStatus, int]] = deque(maxlen=KEPT)
        self.wheels: deque[tuple[WheelCommand, int]] = deque(maxlen=KEPT)
        self.truths: deque[tuple[GroundTruth, int]] = deque(maxlen=KEPT)
        self._requests = count(monotonic_ns())
        heard: Final[tuple[tuple[Topic[Any], deque[Any]], ...]] = (
            (STATUS, self.statuses),
            (DRIVE, self.wheels),
            (TRUTH, self.truths),
        )
        for topic, into in heard:
            bus.stream(topic, keeper(topic, into), ROBOT)

    @property
    def status(self) -> NavigatorStatus:
        return self.statuses[-1][0]

    @property
    def speed_m_s(self) -> float:
        return self.truths[-1][0].speed_m_s if self.truths else 0.0

    @property
    def on_its_way(self) -> bool:
        return GoalState.ACCEPTED <= self.status.goal <= GoalState.ALIGNING

    def ask(self, service: Service, request: Callable[[int], Message]) -> None:
        """Until it is accepted; RuntimeError when it is not in time."""
        deadline_s, answer = monotonic() + PATIENCE_S, None
        while monotonic() < deadline_s:
            try:
                answer = self.bus.ask(service, request(next(self._requests)), 0.5, self.robot)
            except NoAnswer:
                continue
            if isinstance(answer, CommandAck) and answer.result == AckResult.ACCEPTED:
                return
        raise RuntimeError(f"{service.path}: {answer!r}")

    def drive_to(self, x_m: float, y_m: float) -> None:
        """Arm, and go there without an operator."""
        arm, goal = Command.COMPONENT_ARM_DISARM, wire_goal(x_m, y_m, None, 0.1, 0.1)._asdict()
        self.ask(
            COMMAND, lambda n: CommandRequest(request_id=n, param1=1.0, param2=0.0, command=arm)
        )
        self.ask(COMMAND, lambda n: GoalRequest(request_id=n, mode=Mode.AUTO, **goal))

    def stand(self) -> None:
        """Whatever it was about."""
        hold = Command.DO_PAUSE_CONTINUE
        self.ask(
            COMMAND, lambda n: CommandRequest(request_id=n, param1=0.0, param2=0.0, command=hold)
        )

    def pause(self) -> None:
        """Simulated time stands still from now on."""
        pause = RunRequest(action=RunAction.PAUSE, until_ns=0)
        self.ask(RUN, lambda _: pause)


def keeper(topic: Topic[Any], into: deque[tuple[Any, int]]) -> Callable[[str, bytes, int], None]:
    """Return a callback that keeps the messages of a topic and ignores other frames."""

    def keep(_key: str, frame: bytes, arrived_ns: int) -> None:
        message = decode(frame).message
        if isinstance(message, topic.messages):
            into.append((message, arrived_ns))

    return keep


@contextmanager
def observed(
    file: str, *flags: str, keys: Path | None = None, operator: str = "ground"
) -> Iterator[Observer]:
    """Everything in this world but the ground station, which is what is measured.

    With `keys`, a folder of `sidestep keys new`, its doors are locked, and the observer has the
    certificate of the role `operator`.
    """
    world, endpoint = load(file), f"{'tls' if keys else 'tcp'}/127.0.0.1:{free_port()}"
    start = start_words(world.start.x_m, world.start.y_m, world.start.heading_rad)
    own = ["robot", "--id", ROBOT, "--listen", endpoint, "--start", *start, *flags]
    plant = ["plant", "--world", file, "--robots", ROBOT, "--connect", endpoint]
    if keys is not None:
        own += ["--config", str(keys / f"robot-{ROBOT}.toml")]
        plant += ["--config", str(keys / "plant.toml")]
    with ExitStack() as scope:
        robot = scope.enter_context(sidestep(*own, ready="ready"))
        scope.enter_context(sidestep(*plant, ready="plant:"))
        folder = Path(scope.enter_context(TemporaryDirectory()))
        tls = None if keys is None else tls_of(keys, operator)
        network = Network(mode="client", connect=(endpoint,), tls=tls)
        bus = scope.enter_context(open_bus(network, Role.GROUND, ROBOT))
        observer = Observer(bus, world, endpoint, folder)
        observer.pid = robot.pid
        until(lambda: observer.truths and observer.statuses, "truth and status")
        yield observer


class Shuttle:
    """Keeps the robot going between the start of its world and the goal."""

    def __init__(self, observer: Observer) -> None:
        start, goal = observer.world.start, observer.world.goal
        self._observer = observer
        self._places = cycle([(goal.x_m, goal.y_m), (start.x_m, start.y_m)])

    def keep_on(self) -> None:
        """Set off again, when the last goal has ended."""
        if not self._observer.on_its_way:
            self._observer.drive_to(*next(self._places))
            until(lambda: self._observer.on_its_way, "on its way")


def tls_of(keys: Path, role: str) -> Tls:
    """Return the certificate of a role, out of a folder of `sidestep keys new`."""
    certificate, key = str(keys / f"{role}.pem"), str(keys / f"{role}.key")
    return Tls(ca=str(keys / "ca.pem"), certificate=certificate, key=key)


def apart_m(one: GroundTruth, other: GroundTruth) -> float:
    return hypot(one.x_m - other.x_m, one.y_m - other.y_m)
