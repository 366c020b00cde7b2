"""The gateway's copy of the robot's mission or fence, read from the robot on demand."""

from collections.abc import Callable
from typing import Any, Final, Generic, TypeVar

from gateways.mavlink.port import Answered
from gateways.mavlink.vehicle import Vehicle
from ground.client.operations import (
    FenceShown,
    FetchMission,
    MissionFetched,
    Operation,
    ShowFence,
    TransferOutcome,
)
from ground.missions.mission import Fence, Waypoint
from runtime.units import NS_PER_S

T = TypeVar("T")
Key = tuple[int, int]
Then = Callable[[tuple[T, ...] | None, str], None]
"""Receives the robot's values, or None with the reason."""

FRESH_NS: Final = NS_PER_S
PERIOD_NS: Final = 10 * NS_PER_S
"""A change of the fence by another operator is read within this time."""
MAX_WAITING: Final = 64
BUSY: Final = "too many requests at once"


class RobotCopy(Generic[T]):
    """The robot's values when they were last read; `values` is None before that.

    `key` returns a value that changes with the robot's data, None if there is none. A copy without
    a key is read again periodically while there are clients.
    """

    def __init__(
        self,
        vehicle: Vehicle,
        question: Operation[Any],
        parse: Callable[[Answered], tuple[T, ...] | None],
        key: Callable[[], Key | None],
    ) -> None:
        self.values: tuple[T, ...] | None = None
        self._vehicle = vehicle
        self._question = question
        self._parse = parse
        self._key = key
        self._read_key: Key | None = None
        self._asked_key: Key | None = None
        self._read_ns = self._asked_ns = -PERIOD_NS
        self._is_asking = False
        self._waiting: list[Then[T]] = []

    def latest(self, then: Then[T], now_ns: int) -> None:
        """Call `then` with the robot's present values, perhaps in a later round."""
        if self._is_fresh(now_ns):
            then(self.values, "")
        elif len(self._waiting) >= MAX_WAITING:
            then(None, BUSY)
        else:
            self._waiting.append(then)
            self._ask(now_ns)

    def known(self, then: Then[T], now_ns: int) -> None:
        """Call `then` with the values that were last read; read them if there are none."""
        if self.values is None:
            self.latest(then, now_ns)
        else:
            then(self.values, "")

    def adopt(self, values: tuple[T, ...], key: Key | None, now_ns: int) -> None:
        """Store the values that the robot has accepted."""
        self.values, self._read_key = values, key
        self._read_ns = self._asked_ns = now_ns

    def due(self, now_ns: int) -> None:
        """Read the values again if they have changed, or may have changed."""
        vehicle, key = self._vehicle, self._key()
        if not (vehicle.clients and vehicle.snapshot.is_live):
            return
        is_changed = key is not None and key != self._read_key
        period_ns = FRESH_NS if is_changed or self.values is None else PERIOD_NS
        is_unsure = key is None or is_changed
        if is_unsure and now_ns - self._asked_ns >= period_ns:
            self._ask(now_ns)

    def _is_fresh(self, now_ns: int) -> bool:
        if self.values is None:
            return False
        key = self._key()
        recent = now_ns - self._read_ns < FRESH_NS
        return recent if key is None else key == self._read_key

    def _ask(self, now_ns: int) -> None:
        if not self._is_asking:
            self._is_asking = True
            self._asked_ns, self._asked_key = now_ns, self._key()
            self._vehicle.port.perform(self._question, self._read)

    def _read(self, answered: Answered) -> None:
        self._is_asking = False
        waiting, self._waiting = self._waiting, []
        found = self._parse(answered)
        if found is not None:
            self.values = found
            self._read_key, self._read_ns = self._asked_key, self._asked_ns
        for then in waiting:
            then(found, "" if found is not None else answered.text)


def mission_copy(vehicle: Vehicle) -> RobotCopy[Waypoint]:
    """Return the copy of a robot's mission; its status shows a change."""

    def key() -> Key | None:
        status = vehicle.snapshot.mission
        return None if status is None else (status.mission_id, status.count)

    return RobotCopy(vehicle, FetchMission(), waypoints_in, key)


def waypoints_in(answered: Answered) -> tuple[Waypoint, ...] | None:
    """Return the waypoints that the robot has sent, None if it has not answered."""
    outcome = answered.outcome
    if isinstance(outcome, MissionFetched):
        return outcome.mission.waypoints
    return () if isinstance(outcome, TransferOutcome) and outcome.is_none else None


def fence_copy(vehicle: Vehicle) -> RobotCopy[Fence]:
    """Return the copy of a robot's fence, of which there is at most one."""
    return RobotCopy(vehicle, ShowFence(), fences_in, lambda: None)


def fences_in(answered: Answered) -> tuple[Fence, ...] | None:
    """Return the fence that the robot has sent, None if it has not answered."""
    outcome = answered.outcome
    if not isinstance(outcome, FenceShown):
        return None
    return () if outcome.fence is None else (outcome.fence,)
