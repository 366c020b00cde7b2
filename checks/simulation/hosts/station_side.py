"""An operator at the ground station: its model without the screen, polled 20 times a second.

Lease, heartbeat, emergency stop and requests are the station's own. The requests do what the
command line does.
"""

from typing import Any, Final

from checks.simulation.events import Argument
from checks.simulation.hosts.operators import (
    ACTIONS,
    OperatorRequest,
    SimulatedOperator,
)
from checks.simulation.hosts.threads import SimulatedClock, SimulatedQueue
from ground.client.connection import Common
from ground.client.link import Link
from ground.station.robot.background_requests import JobResult
from ground.station.station import Station
from protocol.bus.bus import open_bus
from protocol.topics import Role

POLL_NS: Final = 50_000_000
ACKNOWLEDGED: Final = "E-STOP acknowledged"
STILL: Final = ("param", "fence")
"""Actions that do not move the robot, for which the station takes no lease."""


class StationOperator(SimulatedOperator):
    """An operator whose answers appear in the station's log."""

    _station: Station | None = None
    _press: OperatorRequest | None = None
    _lines_before = 0

    def _main(self) -> None:
        bus = open_bus(self.dials, Role.GROUND, "r1", self.host.now_ns)
        clock = SimulatedClock()
        link = Link(bus, Common(network=self.dials, robot="r1"), clock)
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
        """Press the station's emergency stop, which repeats until acknowledged or given up."""
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
        acknowledged = any(
            ACKNOWLEDGED in line.text for line in station.log.since(self._lines_before)
        )
        self._end(press, True if acknowledged else None)
