"""Read round trip, parameters, mission, fence and world of a robot regularly, in a thread."""

from collections.abc import Callable
from functools import partial
from queue import SimpleQueue
from typing import Final, NamedTuple

from ground.client.parameter import Parameter, parameters_in
from ground.station.robot.background_requests import JobResult, RequestWorker
from ground.station.robot.mission_items import DownloadedItems, downloaded
from ground.station.world import WorldFacts, parse_world
from protocol.bus.bus import Bus
from protocol.bus.network import Hub
from protocol.topics import PARAMETER, PARAMETERS, WORLD
from protocol.wire.enums import MissionType
from protocol.wire.messages import ParamRequestRead
from runtime.clock import Clock
from runtime.errors import RemoteError
from runtime.units import NS_PER_S

PROBE_NS: Final = NS_PER_S
PROBE_OFTEN_NS: Final = NS_PER_S // 4
RARELY_NS: Final = 5 * NS_PER_S
"""Interval of the requests to a robot that is only watched."""
RETRY_NS: Final = NS_PER_S
TIMEOUT_S: Final = 0.5
PROBE_REQUEST: Final = ParamRequestRead(param_id="radius_m", param_index=-1)
"""A request that changes nothing, is not recorded, and is answered by the control loop."""


class Probe(NamedTuple):
    """Hub of the link, and the round trip, None when the robot's loop did not answer.

    `hub` is None if only the round trip was measured. `kept_out` is why the peer rejects this
    station; empty when it does not.
    """

    hub: Hub | None
    round_trip_ns: int | None
    kept_out: str = ""


class ReadParameters(NamedTuple):
    """The robot's parameters, requested at this time."""

    rows: tuple[Parameter, ...]
    asked_ns: int


class ReadFailure(NamedTuple):
    """An item that could not be read, and the reason."""

    what: str
    why: str


ReadResult = Probe | ReadParameters | DownloadedItems | WorldFacts | ReadFailure


class Reader:
    """Sends one request at a time and repeats it later; results wait for `poll`.

    Of a robot that is only watched it reads the parameters, and measures the round trip, rarely:
    `watches_only`.
    """

    def __init__(self, bus: Bus, clock: Clock, robot: str) -> None:
        self.asked = 0
        """Number of requests for the parameters since they were last wanted."""
        self.asked_ns = 0
        """Time of the last request."""
        self.watches_only = True
        self._bus = bus
        self._clock = clock
        self._robot = robot
        self._results: SimpleQueue[ReadResult] = SimpleQueue()
        self._jobs: dict[str, Callable[[], ReadResult]] = {
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
        self._was_hanging = False
        self._rarely_ns = {"probe": 0, "parameters": 0}

    def want(self, what: str) -> None:
        """Read an item, now and until it is available."""
        self._wanted.add(what)
        self._next_ns[what] = 0
        if what == "parameters":
            self.asked = 0

    def want_once(self, what: str) -> None:
        """Read an item unless that is pending."""
        if what not in self._wanted:
            self.want(what)

    def probe_often(self, silent: bool) -> None:
        """Check the link more often while the robot is silent."""
        self._probe_ns = PROBE_OFTEN_NS if silent else PROBE_NS
        self._next_ns["probe"] = min(self._next_ns["probe"], self._probed_ns + self._probe_ns)

    def drop(self, what: str) -> None:
        """Stop reading an item."""
        self._wanted.discard(what)

    def poll(self) -> list[ReadResult]:
        """Return new results."""
        found: list[ReadResult] = []
        while not self._results.empty():
            found.append(self._results.get_nowait())
        return found

    def ask(self, worker: RequestWorker, now_ns: int) -> bool:
        """Send the next request if one is due; return False if none is."""
        if self.watches_only:
            return self._ask_rarely(worker, now_ns)
        for what, job in self._jobs.items():
            if what in self._wanted and now_ns >= self._next_ns[what]:
                if what == "probe":
                    self._probed_ns = now_ns
                self._next_ns[what] = now_ns + (self._probe_ns if what == "probe" else RETRY_NS)
                self._start(worker, now_ns, what, job)
                return True
        return False

    def _ask_rarely(self, worker: RequestWorker, now_ns: int) -> bool:
        """Send what is due of a robot that is only watched: its limits say what it does alone."""
        jobs: dict[str, Callable[[], ReadResult]] = {
            "probe": lambda: Probe(None, self._round_trip_ns()),
            "parameters": self._parameters,
        }
        for what, job in jobs.items():
            if what in self._wanted and now_ns >= self._rarely_ns[what]:
                self._rarely_ns[what] = now_ns + RARELY_NS
                self._start(worker, now_ns, what, job)
                return True
        return False

    def _start(
        self, worker: RequestWorker, now_ns: int, what: str, job: Callable[[], ReadResult]
    ) -> None:
        self.asked_ns = now_ns
        self.asked += what == "parameters"
        worker.start(partial(self._done, what, job))

    def _done(self, what: str, job: Callable[[], ReadResult]) -> JobResult:
        try:
            self._results.put(job())
        except RemoteError as error:
            self._results.put(ReadFailure(what, str(error)))
        return JobResult(True, "")

    def _probe(self) -> Probe:
        hub = self._bus.hub()
        was_hanging, self._was_hanging = self._was_hanging, hub is Hub.HANGS
        if self._was_hanging and was_hanging:  # finding the reason takes time
            return Probe(hub, None, self._bus.kept_out())
        if not hub.linked:
            return Probe(hub, None)
        round_trip_ns = self._round_trip_ns()
        return Probe(self._bus.hub() if round_trip_ns is None else hub, round_trip_ns)

    def _round_trip_ns(self) -> int | None:
        asked_ns = self._clock.now_ns()
        try:
            self._bus.ask(PARAMETER, PROBE_REQUEST, TIMEOUT_S, robot=self._robot)
        except RemoteError:
            return None
        return self._clock.now_ns() - asked_ns

    def _parameters(self) -> ReadParameters:
        asked_ns = self._clock.now_ns()
        answer = self._bus.ask(PARAMETERS, None, TIMEOUT_S, robot=self._robot)
        if not isinstance(answer, bytes):
            raise RemoteError("malformed answer of the robot: not a list of parameters")
        return ReadParameters(tuple(parameters_in(answer)), asked_ns)

    def _world(self) -> WorldFacts:
        answer = self._bus.ask(WORLD, None, TIMEOUT_S, robot=self._robot)
        if not isinstance(answer, bytes):
            raise RemoteError("malformed answer of the plant: not a world")
        return parse_world(answer)
