"""The emergency stop of all robots, and its release: one outcome for each robot."""

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, closing
from dataclasses import dataclass, replace
from typing import ClassVar, Final, TypeVar

from ground.client import stop_ways
from ground.client.connection import Common
from ground.client.emergency_stop import EmergencyStop, MessagePublisher
from ground.client.link import Link, UnansweredError, open_link
from ground.client.outcomes import AllAnswered, Answer, Stopped, Unanswered
from ground.client.presence import present_processes
from ground.client.session import Session
from ground.client.telemetry import Telemetry
from ground.commands.stop import STOP_S, ClearEmergencyStop, StopNow
from protocol.topics import STATUS, STOP
from protocol.wire.messages import CommandRequest, NavigatorStatus
from runtime.errors import RemoteError
from runtime.units import NS_PER_S

T = TypeVar("T")
Out = TypeVar("Out")
MAX_THREADS: Final = 64
NO_ROBOT: Final = "no robot is present at {}: `sidestep doctor` explains why"


@dataclass(frozen=True, slots=True, kw_only=True)
class StopAll:
    """Stop all robots: send to each at once, then repeat each until its status shows the stop.

    Needs no lease, waits for no other request, and no robot refuses it.
    """

    verb: ClassVar[str] = "estop"
    moves: ClassVar[bool] = False
    timeout_s: float = STOP_S

    def perform(self, session: Session, request_id: int = 0) -> AllAnswered:
        """Stop the robots that are known by name at once, then all that are present.

        `request_id` is that of each of these stops; 0: each has one of its own. Raises
        UnansweredError if none is present, and none that is known has acknowledged it.
        """
        link = session.link
        newest = NewestStatuses(link)
        give_up_ns = round(self.timeout_s * NS_PER_S)

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
                known.remove(link.common.robot)  # unless it is present: a name that nobody gave
            robots = list(dict.fromkeys((*present, *known)))
            outcomes = at_once(repeat, [stops[robot] for robot in robots])
        if nobody is not None and not any(outcome.ok for outcome in outcomes):
            raise nobody
        return AllAnswered(tuple(zip(robots, outcomes, strict=True)))

    def perform_alone(self, common: Common) -> AllAnswered:
        """Stop all robots that are known by name at once, then by a session all that are present.

        Raises UnansweredError if none is reached.
        """
        names = known_robots(common)
        met: set[str] = set()
        """Robots for which no other way needs to be tried any more."""

        def stop(robot: str) -> Stopped | Unanswered:
            alone = StopNow(timeout_s=self.timeout_s)
            try:
                return alone.perform_alone(
                    replace(common, robot=robot), opens=False, is_met=lambda: robot in met
                )
            except Exception as error:  # the outcome of the others must not be lost
                return Unanswered(str(error))

        def stop_present() -> AllAnswered | Exception:
            try:
                with open_link(common) as link:
                    found = self.perform(Session(link))
            except Exception as error:
                return error
            met.update(robot for robot, outcome in found.of if outcome.ok)
            if found.ok:
                met.add(common.robot)  # if it is not among them: a name that nobody gave
            return found

        with ThreadPoolExecutor(1) as pool:
            waiting = pool.submit(stop_present)
            known = dict(zip(names, at_once(stop, names), strict=True))
            present = waiting.result()
        stopped = {robot: outcome for robot, outcome in known.items() if outcome.ok}
        if isinstance(present, AllAnswered):
            # A robot that is known by name and neither present nor reached has not stopped.
            named = {name: known[name] for name in names if name != common.robot}
            return AllAnswered(tuple((named | dict(present.of) | stopped).items()))
        if not stopped:
            raise present
        return AllAnswered(tuple(known.items()))


@dataclass(frozen=True, slots=True, kw_only=True)
class ClearAll:
    """Release the emergency stop of all robots; each is then disarmed.

    `stop_ids` are the stops that are known, by robot; of others it is that of the status of now.
    """

    verb: ClassVar[str] = "clear-estop"
    moves: ClassVar[bool] = True
    timeout_s: float | None = None
    stop_ids: tuple[tuple[str, tuple[int, ...]], ...] = ()

    def perform(self, session: Session) -> AllAnswered:
        """Ask every robot that is present; UnansweredError if none is."""
        links = [session.link.to(robot) for robot in present_robots(session.link)]

        def clear(link: Link) -> Answer | Unanswered:
            try:
                stop_ids = dict(self.stop_ids).get(link.robot, ())
                operation = ClearEmergencyStop(timeout_s=self.timeout_s, stop_ids=stop_ids)
                return operation.perform(Session(link, attended=session.attended))
            except RemoteError as error:
                return Unanswered(str(error))

        robots = [link.robot for link in links]
        return AllAnswered(tuple(zip(robots, at_once(clear, links), strict=True)))


class LatePublisher:
    """The publisher of a stop; to declare it may block, and other ways come first."""

    def __init__(self, link: Link, robot: str) -> None:
        self._link, self._robot = link, robot
        self._publisher: MessagePublisher[CommandRequest] | None = None

    def put(self, message: CommandRequest) -> object:
        """Publish a stop; raises what the bus raises."""
        if self._publisher is None:
            self._publisher = self._link.bus.publisher(STOP, self._robot)
        return self._publisher.put(message)


class NewestStatuses:
    """The newest status of each robot, from the moment it is subscribed to."""

    def __init__(self, link: Link) -> None:
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


def present_robots(link: Link) -> list[str]:
    """Return the names of the robots that are present; UnansweredError if there is none."""
    robots = present_processes(link.bus.present()).robots()
    if not robots:
        raise UnansweredError(NO_ROBOT.format(link.endpoint))
    return robots


def at_once(job: Callable[[T], Out], items: Sequence[T]) -> list[Out]:
    """Run a job for each item in a thread of its own; return the results in order."""
    with ThreadPoolExecutor(min(len(items), MAX_THREADS)) as pool:
        return list(pool.map(job, items))
