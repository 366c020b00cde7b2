"""An operator who uses the ground station: its model without the screen, polled 20 times a second.

The lease, the heartbeat, the emergency stop and the requests are the station's own; what a request
does is what the command line does.
"""

from typing import Any, Final

from ground.client.connection import Common
from ground.client.link import Link
from ground.station import JobResult, Station
from protocol.bus.bus import open_bus
from protocol.topics import Role
from verification.simulation.events import Argument
from verification.simulation.hosts.operators import ACTIONS, DIALS, Asked, Operator
from verification.simulation.hosts.threads import SimulatedClock, SimulatedQueue

POLL_NS: Final = 50_000_000
ACKNOWLEDGED: Final = "E-STOP acknowledged"
STILL: Final = ("param", "fence")
"""Actions that move nothing: the station takes no lease for them."""


class StationOperator(Operator):
    """As `Operator`; what it is told is in the station's log."""

    _station: Station | None = None
    _press: Asked | None = None
    _lines_before = 0

    def _main(self) -> None:
        bus = open_bus(DIALS, Role.GROUND, "r1", self.host.now_ns)
        clock = SimulatedClock()
        link = Link(bus, Common(network=DIALS, robot="r1"), clock)
        actions = self._actions = SimulatedQueue()
        live: Any = bus
        station = self._station = Station(live, "r1", clock, name=self.name)
        self._press = None
        self.link = link
        while self._early:
            actions.put(self._early.popleft())
        while True:
            if not station.busy and actions.qsize():
                self._act(station, link, *actions.get_nowait())
            station.poll()
            self._see_stop(station)
            clock.sleep_until(clock.now_ns() + POLL_NS)

    def _act(
        self, station: Station, link: Link, action: str, arguments: tuple[Argument, ...]
    ) -> None:
        if action == "lease":
            if arguments[0] == "RELEASE":
                station.release_lease()
            else:
                station.take_lease(seize=arguments[0] == "SEIZE")
            return

        def job() -> JobResult:
            return JobResult(ACTIONS[action](self, link, *arguments), action)

        station.submit(action, job, moves=action not in STILL)

    def _stop(self) -> None:
        """Press the station's emergency stop, which goes on until it says how it ended."""
        station = self._station
        if station is None:
            return
        station.estop()
        if self._press is None:
            self._lines_before = station.log.total
            self._press = self._begin("stop", None)

    def _see_stop(self, station: Station) -> None:
        press = self._press
        if press is None or station.stopping:
            return
        self._press = None
        told = any(ACKNOWLEDGED in line.text for line in station.log.since(self._lines_before))
        self._end(press, True if told else None)
