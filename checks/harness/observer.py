"""Robot and plant as real processes, an observer that keeps the robot driving, its true motion."""

from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from functools import partial
from itertools import count, cycle, pairwise
from math import hypot
from pathlib import Path
from tempfile import TemporaryDirectory
from time import monotonic_ns
from typing import Any, Final, NamedTuple

from checks.harness.processes import (
    ROBOT,
    arm_request,
    ask_until_accepted,
    auto_goal_request,
    command_request,
    robot_process,
    sidestep,
)
from checks.harness.until import until
from plant.world.file import load
from protocol.bus.bus import Bus, open_bus
from protocol.outcome import wire_goal
from protocol.topics import (
    COMMAND,
    CYCLE,
    DRIVE,
    RUN,
    STATUS,
    TEXT,
    TRUTH,
    Role,
    Service,
    Topic,
)
from protocol.wire.codec import decode
from protocol.wire.enums import Command, GoalState, RunAction
from protocol.wire.message import Message
from protocol.wire.messages import (
    CycleReport,
    GroundTruth,
    NavigatorStatus,
    RunRequest,
    Statustext,
    WheelCommand,
)
from protocol.world import World
from runtime.errors import RemoteError
from runtime.units import NS_PER_S, PERIOD_S

STILL_M_S: Final = 0.001
STILL_RAD_S: Final = 0.01
HOLDS: Final = 8
"""A robot has stopped when so many samples in a row are still."""


class Seen(NamedTuple):
    """A true state, `at_s` after the fault; its speed is that of the period that it ends."""

    at_s: float
    truth: GroundTruth

    @property
    def still(self) -> bool:
        """True if the robot did not move."""
        return is_still(self.truth)


def is_still(truth: GroundTruth) -> bool:
    """Return whether a robot neither drives nor turns."""
    return abs(truth.speed_m_s) < STILL_M_S and abs(truth.yaw_rate_rad_s) < STILL_RAD_S


RECENT: Final = 40
"""Samples whose least delay gives the offset of the plant's clock."""


def motion_since(truths: Iterable[tuple[GroundTruth, int]], since_ns: int) -> list[Seen]:
    """Return the motion from a moment on, by the plant's stamps, which no network delays."""
    rows = tuple(truths)
    early = [(one, at_ns) for one, at_ns in rows if at_ns < since_ns][-RECENT:]
    offset_ns = min(at_ns - one.time_ns for one, at_ns in early)
    seen = [Seen((one.time_ns + offset_ns - since_ns) / NS_PER_S, one) for one, _ in rows]
    return [one for one in seen if one.at_s > 0.0]


def standing_from(seen: Sequence[Seen]) -> int | None:
    """Return the index of the first sample at rest; None if the robot never stopped."""
    row = 0
    for index, one in enumerate(seen):
        row = row + 1 if one.still else 0
        if row == HOLDS:
            return index - HOLDS + 1
    return None


def stood_s(seen: Sequence[Seen]) -> float | None:
    """Return when the wheels stopped: the beginning of the first period without motion."""
    first = standing_from(seen)
    return None if first is None else max(0.0, seen[first].at_s - PERIOD_S)


def distance_m(seen: Sequence[Seen]) -> float:
    """Return the length of the path from the fault until the robot stopped."""
    first = standing_from(seen)
    way = seen if first is None else seen[: first + 1]
    return sum(
        hypot(b.truth.x_m - a.truth.x_m, b.truth.y_m - a.truth.y_m) for a, b in pairwise(way)
    )


def moved_again(seen: Sequence[Seen]) -> bool:
    """Return whether the robot moved after it had stopped."""
    first = standing_from(seen)
    return first is not None and any(not one.still for one in seen[first:])


def contacts(seen: Sequence[Seen]) -> int:
    """Return how many contacts began."""
    touches = [False, *(one.truth.contact != 0 for one in seen)]
    return sum(now and not before for before, now in pairwise(touches))


def touched_s(seen: Sequence[Seen]) -> float | None:
    """Return the time from the first contact until the robot stopped; None without either."""
    for index, one in enumerate(seen):
        if one.truth.contact:
            stood = stood_s(seen[index:])
            return None if stood is None else stood - one.at_s
    return None


PATIENCE_S: Final = 30.0
SET_OFF_S: Final = 3.0
SET_OFFS: Final = 10
KEPT: Final = 2000


class BusWitness:
    """Sees what a robot and its plant publish, each with the time of its arrival.

    `unreadable` counts frames that cannot be read.
    """

    bus: Bus

    def __init__(self, robot: str = ROBOT, kept: int | None = KEPT) -> None:
        """Keep so many samples of each topic; None: all."""
        self.robot = robot
        self.unreadable = 0
        self.texts: list[str] = []
        self.statuses: deque[tuple[NavigatorStatus, int]] = deque(maxlen=kept)
        self.wheels: deque[tuple[WheelCommand, int]] = deque(maxlen=kept)
        self.truths: deque[tuple[GroundTruth, int]] = deque(maxlen=kept)
        self.cycles: deque[tuple[CycleReport, int]] = deque(maxlen=kept)
        self._kept: dict[Topic[Any], deque[Any]] = {
            STATUS: self.statuses,
            DRIVE: self.wheels,
            TRUTH: self.truths,
            CYCLE: self.cycles,
            TEXT: deque(maxlen=0),
        }

    def listen(self, bus: Bus, *topics: Topic[Any]) -> None:
        """Begin to keep what arrives on a bus, of these topics or of all."""
        self.bus = bus
        for topic in topics or self._kept:
            bus.stream(topic, partial(self._keep, topic, self._kept[topic]), self.robot)

    def _keep(
        self, topic: Topic[Any], into: deque[Any], _key: str, frame: bytes, arrived_ns: int
    ) -> None:
        try:
            message = decode(frame).message
        except RemoteError:
            self.unreadable += 1
            return
        if isinstance(message, topic.messages):
            into.append((message, arrived_ns))
            if isinstance(message, Statustext):
                self.texts.append(message.text)

    @property
    def status(self) -> NavigatorStatus:
        """The newest status; waits for the first."""
        until(lambda: self.statuses, "a status")
        return self.statuses[-1][0]

    @property
    def speed_m_s(self) -> float:
        """The newest true speed; 0 before the first sample."""
        return self.truths[-1][0].speed_m_s if self.truths else 0.0


class Observer(BusWitness):
    """A witness that also commands the robot, without a lease."""

    def __init__(self, bus: Bus, world: World, endpoint: str, folder: Path) -> None:
        """Subscribe; `folder` holds the files that programs write to a user's home."""
        super().__init__()
        self.world, self.endpoint, self.folder = world, endpoint, folder
        self.pid = 0
        """Process id of the robot."""
        self._requests = count(monotonic_ns())
        self.listen(bus)

    @property
    def on_its_way(self) -> bool:
        """True if the robot has a goal that has not ended."""
        return GoalState.ACCEPTED <= self.status.goal <= GoalState.ALIGNING

    def ask(
        self, service: Service, request: Callable[[int], Message], within_s: float = PATIENCE_S
    ) -> None:
        """Repeat a request until it is accepted; RuntimeError when it is not in time."""
        ask_until_accepted(
            self.bus, service, lambda: request(next(self._requests)), self.robot, within_s
        )

    def drive_to(self, x_m: float, y_m: float) -> None:
        """Arm, and drive to a place without an operator.

        On a busy machine the robot may be late and stop in between: then it is armed again.
        """
        goal = wire_goal(x_m, y_m, None, 0.1, 0.1)
        for _ in range(SET_OFFS):
            self.ask(COMMAND, arm_request)
            with suppress(RuntimeError):
                self.ask(COMMAND, lambda number: auto_goal_request(number, goal), SET_OFF_S)
                return
        raise RuntimeError(f"{self.robot} was stopped {SET_OFFS} times before it could set off")

    def hold(self) -> None:
        """Stop the robot and hold its goal."""
        self.ask(COMMAND, lambda number: command_request(number, Command.DO_PAUSE_CONTINUE))

    def pause(self) -> None:
        """Pause simulated time."""
        pause = RunRequest(action=RunAction.PAUSE, until_ns=0)
        self.ask(RUN, lambda _: pause)


@contextmanager
def observed(
    file: str, *flags: str, keys: Path | None = None, operator: str = "ground"
) -> Iterator[Observer]:
    """Start robot and plant in a world and observe them, without a ground station.

    With `keys`, a folder of `sidestep keys new`, access is controlled, and the observer has the
    certificate of the role `operator`.
    """
    world = load(file)
    with ExitStack() as scope:
        robot = scope.enter_context(robot_process(world, *flags, keys=keys, client=operator))
        (endpoint,) = robot.network.connect
        locked = () if keys is None else ("--config", str(keys / "plant.toml"))
        plant = ("--world", file, "--robots", ROBOT, "--connect", endpoint, *locked)
        scope.enter_context(sidestep("run", "plant", *plant, ready="plant:"))
        folder = Path(scope.enter_context(TemporaryDirectory()))
        bus = scope.enter_context(open_bus(robot.network, Role.GROUND, ROBOT))
        observer = Observer(bus, world, endpoint, folder)
        observer.pid = robot.pid
        until(lambda: observer.truths and observer.statuses, "truth and status")
        yield observer


class Shuttle:
    """Keeps the robot driving between the start of its world and the goal."""

    def __init__(self, observer: Observer) -> None:
        start, goal = observer.world.start, observer.world.goal
        self._observer = observer
        self._places = cycle([(goal.x_m, goal.y_m), (start.x_m, start.y_m)])

    def keep_driving(self) -> None:
        """Set off again if the last goal has ended."""
        if not self._observer.on_its_way:
            self._observer.drive_to(*next(self._places))
            until(lambda: self._observer.on_its_way, "on its way")


def apart_m(one: GroundTruth, other: GroundTruth) -> float:
    """Return the distance between two true positions."""
    return hypot(one.x_m - other.x_m, one.y_m - other.y_m)
