"""Answers that are withheld until what they vouch for is on the disk."""

from typing import Final, NamedTuple

from protocol.bus import Asked
from protocol.bus.service import refusal
from protocol.enums import AckResult
from protocol.message import Message
from robot.core import reasons
from robot.vehicle import Answer, Vehicle, once_saved
from robot.writer import Ticket

MAX_WITHHELD: Final = 64


class Withheld(NamedTuple):
    """A request whose answer waits for the disk."""

    asked: Asked
    answer: Answer
    ticket: Ticket


class SavedReplies:
    """Replies to requests: at once, or as soon as a file is written or could not be."""

    def __init__(self, vehicle: Vehicle) -> None:
        self._vehicle = vehicle
        self._withheld: list[Withheld] = []

    def reply(self, asked: Asked, request: Message, answer: Answer) -> None:
        """Answer a request. Those beyond a bound are to ask again."""
        ticket = self._vehicle.saving(request, answer)
        if ticket is None or not ticket.is_open:
            asked.reply(answer)
        elif len(self._withheld) < MAX_WITHHELD:
            self._withheld.append(Withheld(asked, answer, ticket))
        else:
            asked.reply(refusal(reasons.TOO_MANY_REQUESTS, result=AckResult.TEMPORARILY_REJECTED))

    def settle(self) -> None:
        """Send the answers whose files have been written meanwhile."""
        self._vehicle.collect_saved()
        withheld, self._withheld = self._withheld, []
        for one in withheld:
            if one.ticket.is_open:
                self._withheld.append(one)
            else:
                one.asked.reply(once_saved(one.answer, one.ticket))
