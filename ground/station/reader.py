"""Read round trip, parameters, mission, fence and world of a robot regularly."""

import logging
from collections.abc import Callable, Coroutine
from functools import partial
from typing import Any, Final, NamedTuple

from ground.client.parameter import Parameter, parameters_in
from ground.missions.transfer import Download, Downloaded
from ground.robot import Robot
from ground.station.robot.mission_items import DownloadedItems
from ground.station.world import WorldFacts, parse_world
from protocol.bus.network import Hub
from protocol.topics import MISSION_SERVICE, PARAMETER, PARAMETERS, WORLD
from protocol.wire.enums import MissionType
from protocol.wire.messages import ParamRequestRead
from runtime.errors import RemoteError
from runtime.units import NS_PER_S

LOG = logging.getLogger(__name__)
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

    `hub` is None if only the round trip was measured, else it was the hub at `checked_ns`.
    `kept_out` is why the peer rejects this station; empty when it does not.
    """

    hub: Hub | None
    checked_ns: int
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
Read = Callable[[], Coroutine[Any, Any, ReadResult]]
Reading = Callable[[], Coroutine[Any, Any, None]]
"""Sends a request and keeps its result."""


class Reader:
    """Sends one request at a time and repeats it later; results wait for `poll`.

    Of a robot that is only watched it reads the parameters, and measures the round trip, rarely:
    `watches_only`.
    """

    def __init__(self, robot: Robot) -> None:
        self.asked = 0
        """Number of requests for the parameters since they were last wanted."""
        self.asked_ns = 0
        """Time of the last request."""
        self.watches_only = True
        self._robot = robot
        self._results: list[ReadResult] = []
        self._reads: dict[str, Read] = {
            "probe": partial(robot.in_own_thread, self._probe),
            "parameters": self._parameters,
            "mission": partial(self._items, MissionType.MISSION),
            "fence": partial(self._items, MissionType.FENCE),
            "world": self._world,
        }
        self._next_ns = dict.fromkeys(self._reads, 0)
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
        found, self._results = self._results, []
        return found

    def due(self, now_ns: int) -> Reading | None:
        """Return what sends the next request; None if none is due."""
        if self.watches_only:
            return self._due_rarely(now_ns)
        for what, read in self._reads.items():
            if what in self._wanted and now_ns >= self._next_ns[what]:
                if what == "probe":
                    self._probed_ns = now_ns
                self._next_ns[what] = now_ns + (self._probe_ns if what == "probe" else RETRY_NS)
                return self._begin(now_ns, what, read)
        return None

    def _due_rarely(self, now_ns: int) -> Reading | None:
        """Return what is due of a robot that is only watched: its limits say what it does alone."""
        reads: dict[str, Read] = {
            "probe": partial(
                self._robot.in_own_thread, lambda: Probe(None, 0, self._round_trip_ns())
            ),
            "parameters": self._parameters,
        }
        for what, read in reads.items():
            if what in self._wanted and now_ns >= self._rarely_ns[what]:
                self._rarely_ns[what] = now_ns + RARELY_NS
                return self._begin(now_ns, what, read)
        return None

    def _begin(self, now_ns: int, what: str, read: Read) -> Reading:
        self.asked_ns = now_ns
        self.asked += what == "parameters"
        return partial(self._carry_out, what, read)

    async def _carry_out(self, what: str, read: Read) -> None:
        result: ReadResult
        try:
            result = await read()
        except RemoteError as error:
            result = ReadFailure(what, str(error))
        except Exception as error:
            LOG.exception("a request has failed")
            result = ReadFailure(what, f"internal error of the ground station: {error!r}")
        self._results.append(result)

    def _probe(self) -> Probe:
        hub, checked_ns = self._check()
        was_hanging, self._was_hanging = self._was_hanging, hub is Hub.HANGS
        if self._was_hanging and was_hanging:  # finding the reason takes time
            return Probe(hub, checked_ns, None, self._robot.bus.kept_out())
        if not hub.linked:
            return Probe(hub, checked_ns, None)
        round_trip_ns = self._round_trip_ns()
        if round_trip_ns is None:
            hub, checked_ns = self._check()
        return Probe(hub, checked_ns, round_trip_ns)

    def _check(self) -> tuple[Hub, int]:
        """Return the hub, and the time from before the check, which may take seconds.

        A link that is lost meanwhile, or before the result is processed, was not seen intact.
        """
        checked_ns = self._robot.clock.now_ns()
        return self._robot.bus.hub(), checked_ns

    def _round_trip_ns(self) -> int | None:
        """Measure it in a thread, because a redraw may hold up the event loop."""
        bus, clock = self._robot.bus, self._robot.clock
        asked_ns = clock.now_ns()
        try:
            bus.ask(PARAMETER, PROBE_REQUEST, TIMEOUT_S, robot=self._robot.name)
        except RemoteError:
            return None
        return clock.now_ns() - asked_ns

    async def _parameters(self) -> ReadParameters:
        asked_ns = self._robot.clock.now_ns()
        answer = await self._robot.answer(PARAMETERS, None, TIMEOUT_S)
        if not isinstance(answer, bytes):
            raise RemoteError("malformed answer of the robot: not a list of parameters")
        return ReadParameters(tuple(parameters_in(answer)), asked_ns)

    async def _world(self) -> WorldFacts:
        answer = await self._robot.answer(WORLD, None, TIMEOUT_S)
        if not isinstance(answer, bytes):
            raise RemoteError("malformed answer of the plant: not a world")
        return parse_world(answer)

    async def _items(self, kind: MissionType) -> DownloadedItems:
        """Download all items, possibly none; RemoteError when a request stays unanswered."""
        robot, clock = self._robot, self._robot.clock
        download = Download(kind, clock.now_ns())
        while not download.over:
            for send in download.due(clock.now_ns()):
                answer = await robot.answer(MISSION_SERVICE, send.request, TIMEOUT_S)
                download.receive(answer, clock.now_ns())
            if not download.over:
                await robot.sleep_until(download.next_ns)
        if isinstance(download.outcome, Downloaded):
            return DownloadedItems(kind, download.outcome.items)
        raise RemoteError(f"the robot did not send its {kind.name.lower()}")
