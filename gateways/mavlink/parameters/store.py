"""The robot's parameters as last read, shared by the PARAM protocol, the files and the streams."""

from collections.abc import Callable
from typing import Final

from gateways.mavlink.parameters.metadata import Metadata, metadata_of
from gateways.mavlink.parameters.table import MavTable, table_of
from gateways.mavlink.port import Answered
from gateways.mavlink.vehicle import Vehicle
from ground.client.operations import ShowParameters
from ground.client.operations.parameters import ParameterTable
from runtime.units import NS_PER_S

FRESH_NS: Final = NS_PER_S
PERIOD_NS: Final = 10 * NS_PER_S
"""Changes by other operators are read within this time."""
MAX_WAITING: Final = 64
BUSY: Final = "too many requests for parameters at once"

Then = Callable[[MavTable | None, str], None]
"""Receives the table, or None with the reason."""


class ParameterStore:
    """Reads the list on request, and periodically while there are clients."""

    def __init__(self, vehicle: Vehicle) -> None:
        self.table: MavTable | None = None
        self._metadata: Metadata | None = None
        self._vehicle = vehicle
        self._waiting: list[Then] = []
        self._is_asking = False
        self._asked_ns = -PERIOD_NS
        self._read_ns = -PERIOD_NS

    @property
    def metadata(self) -> Metadata | None:
        """The files that describe the parameters, None while the parameters are unknown."""
        if self._metadata is None and self.table is not None:
            self._metadata = metadata_of(self.table)
        return self._metadata

    def due(self, now_ns: int) -> None:
        """Read the list if its time has come."""
        vehicle = self._vehicle
        is_time = now_ns - self._asked_ns >= PERIOD_NS
        if is_time and vehicle.clients and vehicle.snapshot.is_live:
            self._ask(now_ns)

    def latest(self, then: Then, now_ns: int) -> None:
        """Call `then` with a table that is at most a second old, perhaps in a later round."""
        if self.table is not None and now_ns - self._read_ns < FRESH_NS:
            then(self.table, "")
        elif len(self._waiting) >= MAX_WAITING:
            then(None, BUSY)
        else:
            self._waiting.append(then)
            self._ask(now_ns)

    def known(self, then: Then, now_ns: int) -> None:
        """Call `then` with the table that was last read; read it if there is none."""
        if self.table is None:
            self.latest(then, now_ns)
        else:
            then(self.table, "")

    def adopt(self, index: int, value: float) -> None:
        """Store the value that the robot has reported for one parameter.

        Send it to all clients.
        """
        if self.table is not None and index < len(self.table):
            self._use(self.table.with_value(index, value))
            self._vehicle.outbox.send(self.table.message(index))
            for client in self._vehicle.lossy:
                self._vehicle.outbox.send(self.table.message(index), client)

    def _ask(self, now_ns: int) -> None:
        if not self._is_asking:
            self._is_asking = True
            self._asked_ns = now_ns
            self._vehicle.port.perform(ShowParameters(), self._read)

    def _read(self, answer: Answered) -> None:
        self._is_asking = False
        waiting, self._waiting = self._waiting, []
        if not isinstance(answer.outcome, ParameterTable):
            for then in waiting:
                then(None, answer.text)
            return
        older, table = self.table, table_of(answer.outcome.parameters)
        self._read_ns = self._asked_ns
        self._use(table)
        for index in [] if older is None else table.changed_since(older):
            self._vehicle.outbox.send(table.message(index))
        for then in waiting:
            then(table, "")

    def _use(self, table: MavTable) -> None:
        if self.table is None or not table.describes_same(self.table):
            self._metadata = None
        self.table = table
        own = (one.own for one in table.parameters if not one.is_fixed)
        self._vehicle.parameters = {one.name: one.value for one in own}
