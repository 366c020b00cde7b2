"""What is read from time to time: round trip, parameters, mission, fence, world. In a thread."""

from collections.abc import Callable
from functools import partial
from queue import SimpleQueue
from typing import Final, NamedTuple

from ground.client.parameter import Parameter, parameters_in
from ground.station.bus_protocols import LiveBus
from ground.station.robot.background_requests import JobResult, RequestWorker
from ground.station.robot.mission_items import Items, downloaded
from ground.station.world import WorldFacts, world_in
from protocol.bus.network import Hub
from protocol.topics import PARAMETER, PARAMETERS, WORLD
from protocol.wire.enums import MissionType
from protocol.wire.messages import ParamRequestRead
from runtime.clock import Clock
from runtime.errors import RemoteError
from runtime.units import NS_PER_S

PROBE_NS: Final = NS_PER_S
HURRIED_NS: Final = NS_PER_S // 4
RETRY_NS: Final = NS_PER_S
PATIENCE_S: Final = 0.5
SMALL: Final = ParamRequestRead(param_id="radius_m", param_index=-1)
"""Changes nothing, is not recorded, and is answered by the control loop itself."""


class Probe(NamedTuple):
    """`hub` is who links us; the round trip is None when the robot's loop did not answer.

    `kept_out`: why who takes our call lets us not in; empty when that is not what is wrong.
    """

    hub: Hub
    round_trip_ns: int | None
    kept_out: str = ""


class Parameters(NamedTuple):
    """The robot's whole list, asked at this instant."""

    rows: tuple[Parameter, ...]
    asked_ns: int


class Failed(NamedTuple):
    """What could not be read, and why."""

    what: str
    why: str


Found = Probe | Parameters | Items | WorldFacts | Failed


class Reader:
    """One question at a time, each again after a while; what is found waits for `poll`."""

    def __init__(self, bus: LiveBus, clock: Clock, robot: str, lane: RequestWorker) -> None:
        self.asked = 0
        """How often the parameters were asked for since they were last wanted."""
        self._bus = bus
        self._clock = clock
        self._robot = robot
        self._lane = lane
        self._found: SimpleQueue[Found] = SimpleQueue()
        self._jobs: dict[str, Callable[[], Found]] = {
            "probe": self._probe,
            "parameters": self._parameters,
            "mission": lambda: downloaded(bus, clock, robot, MissionType.MISSION),
            "fence": lambda: downloaded(bus, clock, robot, MissionType.FENCE),
            "world": self._world,
        }
        self._next_ns = dict.fromkeys(self._jobs, 0)
        self._wanted = {"probe", "parameters", "mission", "fence"}
        self._probe_ns = PROBE_NS
        self._probed_ns = 0
        self._hangs = False

    def want(self, what: str) -> None:
        """Read it, now and until it is there."""
        self._wanted.add(what)
        self._next_ns[what] = 0
        if what == "parameters":
            self.asked = 0

    def want_once(self, what: str) -> None:
        """The same, unless it is wanted already."""
        if what not in self._wanted:
            self.want(what)

    def hurry(self, silent: bool) -> None:
        """While nothing is heard the link is looked at more often."""
        self._probe_ns = HURRIED_NS if silent else PROBE_NS
        self._next_ns["probe"] = min(self._next_ns["probe"], self._probed_ns + self._probe_ns)

    def drop(self, what: str) -> None:
        self._wanted.discard(what)

    def poll(self, now_ns: int) -> list[Found]:
        """What was found, and the next question on its way."""
        self._lane.done()
        found: list[Found] = []
        while not self._found.empty():
            found.append(self._found.get_nowait())
        if not self._lane.busy:
            self._ask(now_ns)
        return found

    def _ask(self, now_ns: int) -> None:
        for what, job in self._jobs.items():
            if what in self._wanted and now_ns >= self._next_ns[what]:
                if what == "probe":
                    self._probed_ns = now_ns
                self._next_ns[what] = now_ns + (self._probe_ns if what == "probe" else RETRY_NS)
                self.asked += what == "parameters"
                self._lane.start(partial(self._done, what, job))
                return

    def _done(self, what: str, job: Callable[[], Found]) -> JobResult:
        try:
            self._found.put(job())
        except RemoteError as error:
            self._found.put(Failed(what, str(error)))
        return JobResult(True, "")

    def _probe(self) -> Probe:
        hub = self._bus.hub()
        again, self._hangs = self._hangs, hub is Hub.HANGS
        if self._hangs and again:  # to find out takes a while, so the news come first
            return Probe(hub, None, self._bus.kept_out())
        if not hub.linked:
            return Probe(hub, None)
        asked_ns = self._clock.now_ns()
        try:
            self._bus.ask(PARAMETER, SMALL, PATIENCE_S, robot=self._robot)
        except RemoteError:
            return Probe(self._bus.hub(), None)
        return Probe(hub, self._clock.now_ns() - asked_ns)

    def _parameters(self) -> Parameters:
        asked_ns = self._clock.now_ns()
        answer = self._bus.ask(PARAMETERS, None, PATIENCE_S, robot=self._robot)
        if not isinstance(answer, bytes):
            raise RemoteError("the robot answers, but not with a list of parameters")
        return Parameters(tuple(parameters_in(answer)), asked_ns)

    def _world(self) -> WorldFacts:
        answer = self._bus.ask(WORLD, None, PATIENCE_S, robot=self._robot)
        if not isinstance(answer, bytes):
            raise RemoteError("the plant answers, but not with its world")
        return world_in(answer)
