"""MISSION_ITEM_REACHED, from changes of the robot's mission status."""

from typing import Final

from gateways.mavlink.dialect import MavMessage, mavlink
from gateways.mavlink.missions.current import CROSSING_NS, UNDER_WAY, CurrentItem
from gateways.mavlink.traffic import Sender
from gateways.mavlink.vehicle import Vehicle
from protocol.wire.enums import MissionState
from protocol.wire.messages import MissionStatus
from runtime.units import NS_PER_S

AGAIN_NS: Final = NS_PER_S
COPIES: Final = 4
"""Number of repetitions of the message: MAVSDK does not finish a mission before it receives one."""


class ReachedItems:
    """Sends each item that is reached, after a change of the robot's mission status.

    The robot waits at an item, starts the next one, or has finished the last one. A jump to the
    next item by another operator looks like the second case.
    """

    handles = ()

    def __init__(self, vehicle: Vehicle, current: CurrentItem) -> None:
        self._vehicle = vehicle
        self._current = current
        self._last: MissionStatus | None = None
        self._reached: int | None = None
        self._copies = 0
        self._next_ns = 0

    def receive(self, message: MavMessage, sender: Sender, now_ns: int) -> None:
        """Take no message."""

    def due(self, now_ns: int) -> None:
        """Find reached items, and repeat the message some times."""
        last, status = self._last, self._vehicle.snapshot.mission
        self._last = status
        if status is None or last is None or status.mission_id != last.mission_id:
            self._reached, self._copies = None, 0
        else:
            index = self._index(last, status, now_ns)
            if index is not None and index != self._reached:
                self._reached, self._copies, self._next_ns = index, COPIES, now_ns
            elif status.state == MissionState.RUNNING and self._reached == status.current:
                self._reached = None  # the robot drives to it once more
        if self._copies and now_ns >= self._next_ns:
            self._send(now_ns)

    def forget(self, client: int) -> None:
        """Keep nothing for a client."""

    def _index(self, last: MissionStatus, status: MissionStatus, now_ns: int) -> int | None:
        """Return the index of the item that has been reached between two states."""
        if status.state == MissionState.HOLDING:
            return status.current
        if status.state == MissionState.DONE and last.state != MissionState.DONE:
            return status.current
        has_jumped = now_ns < self._current.jumped_ns + CROSSING_NS
        is_next = status.current == last.current + 1
        was_under_way = last.state in UNDER_WAY and status.state in UNDER_WAY
        return last.current if is_next and was_under_way and not has_jumped else None

    def _send(self, now_ns: int) -> None:
        self._copies, self._next_ns = self._copies - 1, now_ns + AGAIN_NS
        item = 0 if self._reached is None else self._reached + 1
        self._vehicle.outbox.send(mavlink.MAVLink_mission_item_reached_message(item))
