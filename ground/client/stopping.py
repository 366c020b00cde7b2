"""The emergency stop of all robots over an open bus; it blocks, so it has a thread of its own."""

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, closing
from typing import Final, TypeVar

from ground.client import stop_ways
from ground.client.connection import Common
from ground.client.emergency_stop import EmergencyStop, MessagePublisher
from ground.client.outcomes import AllAnswered, Stopped
from ground.client.presence import present_processes
from ground.client.robot_link import RobotLink, UnansweredError
from ground.client.telemetry import Telemetry
from protocol.topics import STATUS, STOP
from protocol.wire.messages import CommandRequest, NavigatorStatus

T = TypeVar("T")
Out = TypeVar("Out")
MAX_THREADS: Final = 64
NO_ROBOT: Final = "no robot is present at {}: `sidestep doctor` explains why"


def stop_all(link: RobotLink, give_up_ns: int, request_id: int = 0) -> AllAnswered:
    """Stop the robots that are known by name at once, then all that are present.

    Each stop is repeated until the robot's status shows it. `request_id` is that of each of these
    stops; 0: each has one of its own. Raises UnansweredError if no robot is present, and none that
    is known has acknowledged its stop.
    """
    newest = NewestStatuses(link)

    def repeat(stop: EmergencyStop) -> Stopped:
        return Stopped(stop.run(give_up_ns=give_up_ns), stop.robot)

    with ExitStack() as opened:
        stops: dict[str, EmergencyStop] = {}

        def press(robot: str) -> None:
            ways = opened.enter_context(closing(stop_ways.ways_of(link.bus, robot)))
            publisher = LatePublisher(link, robot)
            stop = EmergencyStop(
                link.bus, publisher, robot, link.clock, newest.of(robot), ways, request_id
            )
            stop.press()
            stops[robot] = stop

        known = known_robots(link.common)
        for robot in known:
            press(robot)
        nobody: Exception | None = None
        try:
            present = present_robots(link)
        except Exception as error:  # without the bus, too, the other ways must be repeated
            present, nobody = [], error
        for robot in present:
            if robot not in stops:
                press(robot)
        if nobody is None:
            opened.enter_context(newest.subscribed(present))
            known.remove(link.name)  # unless it is present: a name that nobody gave
        robots = list(dict.fromkeys((*present, *known)))
        outcomes = at_once(repeat, [stops[robot] for robot in robots])
    if nobody is not None and not any(outcome.ok for outcome in outcomes):
        raise nobody
    return AllAnswered(tuple(zip(robots, outcomes, strict=True)))


class LatePublisher:
    """The publisher of a stop; to declare it may block, and other ways come first."""

    def __init__(self, link: RobotLink, robot: str) -> None:
        self._link, self._robot = link, robot
        self._publisher: MessagePublisher[CommandRequest] | None = None

    def put(self, message: CommandRequest) -> object:
        """Publish a stop; raises what the bus raises."""
        if self._publisher is None:
            self._publisher = self._link.bus.publisher(STOP, self._robot)
        return self._publisher.put(message)


class NewestStatuses:
    """The newest status of each robot, from the moment it is subscribed to."""

    def __init__(self, link: RobotLink) -> None:
        self._link = link
        self._telemetry: dict[str, Telemetry] = {}

    def of(self, robot: str) -> Callable[[], tuple[NavigatorStatus, int] | None]:
        """Return a function that returns the newest status of a robot and its arrival time."""

        def newest() -> tuple[NavigatorStatus, int] | None:
            telemetry = self._telemetry.get(robot)
            return None if telemetry is None else telemetry.latest(STATUS)

        return newest

    def subscribed(self, robots: Sequence[str]) -> ExitStack:
        """Subscribe to the robots for the duration of the context."""
        with ExitStack() as opened:
            for robot in robots:
                subscription = self._link.to(robot).subscribed(STATUS)
                self._telemetry[robot] = opened.enter_context(subscription)
            return opened.pop_all()


def known_robots(common: Common) -> list[str]:
    """Return the names of the robots that are known without asking anybody."""
    return list(dict.fromkeys((common.robot, *common.robots, *common.network.stop_at)))


def present_robots(link: RobotLink) -> list[str]:
    """Return the names of the robots that are present; UnansweredError if there is none."""
    robots = present_processes(link.bus.present()).robots()
    if not robots:
        raise UnansweredError(NO_ROBOT.format(link.endpoint))
    return robots


def at_once(job: Callable[[T], Out], items: Sequence[T]) -> list[Out]:
    """Run a job for each item in a thread of its own; return the results in order."""
    with ThreadPoolExecutor(min(len(items), MAX_THREADS)) as pool:
        return list(pool.map(job, items))
