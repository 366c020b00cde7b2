"""What the robot has, as it was last read: services share each reading, which begins on demand."""

import asyncio
from collections.abc import Callable
from typing import Any, Final, Generic, TypeVar

from gateways.mavlink.mav_vehicle import MavVehicle
from gateways.mavlink.robot_port import Answered
from ground.client.outcomes import Operation
from runtime.errors import RemoteError
from runtime.units import NS_PER_S

T = TypeVar("T")
Key = tuple[int, int]
FRESH_NS: Final = NS_PER_S
PERIOD_NS: Final = 10 * NS_PER_S
"""A change by another operator is read within this time."""
MAX_WAITING: Final = 256
"""Requests that wait for one reading; ground stations ask for 50 values at a time."""
BUSY: Final = "too many requests at once"


class RobotCopy(Generic[T]):
    """The robot's values when they were last read; `values` is None before that.

    `parse` returns what the robot has sent, None if it has not answered. `key` returns a value that
    changes with the robot's data, None if there is none. A copy without a key is read again
    periodically while there are clients; without values it is tried again after `again_ns`.
    """

    busy = BUSY
    again_ns = FRESH_NS

    def __init__(
        self,
        vehicle: MavVehicle,
        question: Operation[Any],
        parse: Callable[[Answered], T | None],
        key: Callable[[], Key | None] = lambda: None,
    ) -> None:
        self.values: T | None = None
        self._vehicle = vehicle
        self._question = question
        self._parse = parse
        self._key = key
        self._read_key: Key | None = None
        self._read_ns = self._asked_ns = -PERIOD_NS
        self._is_asking = False
        self._waiting: list[asyncio.Future[T]] = []

    async def latest(self, now_ns: int) -> T:
        """Return the robot's present values; RemoteError if it does not send them."""
        if self.values is not None and self._is_fresh(now_ns):
            return self.values
        if len(self._waiting) >= MAX_WAITING:
            raise RemoteError(self.busy)
        read: asyncio.Future[T] = asyncio.get_running_loop().create_future()
        self._waiting.append(read)
        self._ask(now_ns)
        return await read

    async def known(self, now_ns: int) -> T:
        """Return the values that were last read; read them if there are none."""
        return await self.latest(now_ns) if self.values is None else self.values

    def adopt(self, values: T, key: Key | None, now_ns: int) -> None:
        """Store the values that the robot has accepted."""
        self.values, self._read_key = values, key
        self._read_ns = self._asked_ns = now_ns

    def due(self, now_ns: int) -> None:
        """Read the values again if they have changed, or may have changed."""
        vehicle, key = self._vehicle, self._key()
        if not (vehicle.clients and vehicle.snapshot.is_live):
            return
        is_changed = key is not None and key != self._read_key
        is_missing = is_changed or self.values is None
        is_unsure = key is None or is_changed
        if is_unsure and now_ns - self._asked_ns >= (self.again_ns if is_missing else PERIOD_NS):
            self._ask(now_ns)

    def _is_fresh(self, now_ns: int) -> bool:
        key = self._key()
        return now_ns - self._read_ns < FRESH_NS if key is None else key == self._read_key

    def _ask(self, now_ns: int) -> None:
        if not self._is_asking:
            self._is_asking, self._asked_ns = True, now_ns
            self._vehicle.start(self._read(self._key()))

    async def _read(self, key: Key | None) -> None:
        answered = await self._vehicle.port.perform(self._question)
        self._is_asking = False
        waiting, self._waiting = self._waiting, []
        values = self._parse(answered)
        if values is not None:
            self._take(values)
            self._read_key, self._read_ns = key, self._asked_ns
        for read in waiting:
            if values is None:
                read.set_exception(RemoteError(answered.text))
            else:
                read.set_result(values)

    def _take(self, values: T) -> None:
        """Keep what has been read."""
        self.values = values
