"""Downloads of one kind: the client asks for items by MISSION_REQUEST or MISSION_REQUEST_INT."""

from typing import Any, Final

from gateways.mavlink.dialect import MissionCount
from gateways.mavlink.missions.clients import Answers, ClientKey, key_of
from gateways.mavlink.missions.item_messages import item_message
from gateways.mavlink.missions.kinds import HOME, ItemKind, MissionKind
from gateways.mavlink.missions.results import ERROR, SEQUENCE, Refusal
from gateways.mavlink.missions.uploads import Uploads
from gateways.mavlink.traffic import Sender
from gateways.mavlink.vehicle import Vehicle

MAX_WAITING: Final = 16
"""Requests of all clients that wait for the robot."""


class Downloads:
    """Sends items, unless another client uploads."""

    def __init__(
        self, vehicle: Vehicle, kind: ItemKind[Any, Any], uploads: Uploads, answers: Answers
    ) -> None:
        self._vehicle = vehicle
        self._kind = kind
        self._uploads = uploads
        self._answers = answers
        self._waiting: set[tuple[ClientKey, int]] = set()

    def count(self, sender: Sender, now_ns: int) -> None:
        """Send the number of items, as the robot has them now."""
        if not self._may_read(sender, now_ns):
            return
        waiting = (key_of(sender), -1)
        if self._is_waiting(waiting):
            return
        self._waiting.add(waiting)

        def then(values: tuple[Any, ...] | None, why: str) -> None:
            self._waiting.discard(waiting)
            if values is None:
                self._refuse(sender, ERROR, why)
                return
            number, kind = len(self._kind.items(values)), self._kind
            fields = (sender.system, sender.component, number, kind.number, kind.id_of(values))
            self._vehicle.answer(MissionCount(*fields), sender.client)

        self._kind.copy.latest(then, now_ns)

    def item(self, number: int, sender: Sender, now_ns: int, *, is_int: bool) -> None:
        """Send one item, in the form that was asked for."""
        if not self._may_read(sender, now_ns):
            return
        waiting = (key_of(sender), number)
        if self._is_waiting(waiting):
            return
        self._waiting.add(waiting)

        def then(values: tuple[Any, ...] | None, why: str) -> None:
            self._waiting.discard(waiting)
            items = [] if values is None else list(self._kind.items(values))
            if number == HOME and not items and isinstance(self._kind, MissionKind):
                items = [self._kind.home]  # which DroneKit asks for without a mission, too
            if number < len(items):
                message = item_message(items[number], self._kind.number, sender, is_int=is_int)
                self._vehicle.answer(message, sender.client)
            elif values is None:
                self._refuse(sender, ERROR, why)
            else:
                self._refuse(sender, SEQUENCE, f"there is no item {number}")

        self._kind.copy.known(then, now_ns)

    def forget(self, client: int) -> None:
        """Drop the waiting requests of a client that has disconnected."""
        self._waiting = {one for one in self._waiting if one[0][0] != client}

    def _may_read(self, sender: Sender, now_ns: int) -> bool:
        """Return whether to answer; ignore requests that are older than the client's own upload."""
        if self._uploads.is_of_other(sender):
            self._uploads.deny(sender)
            return False
        if self._uploads.is_active(sender, now_ns):
            return False
        self._uploads.cancel(sender)
        return True

    def _is_waiting(self, waiting: tuple[ClientKey, int]) -> bool:
        return waiting in self._waiting or len(self._waiting) >= MAX_WAITING

    def _refuse(self, sender: Sender, result: int, why: str) -> None:
        refusal = Refusal(result, f"{self._kind.name}: {why}")
        self._answers.refuse(sender, self._kind.number, refusal)
