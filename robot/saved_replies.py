"""Answers that are withheld until what they vouch for is on the disk."""

from typing import Final, NamedTuple

from protocol.bus import Asked
from protocol.bus.service import refusal
from protocol.enums import AckResult, Severity
from protocol.message import Message
from robot.core import reasons
from robot.vehicle import Answer, Vehicle, not_saved, once_saved
from robot.writer import Ticket

MAX_WITHHELD: Final = 64
SLOW_NS: Final = 3_000_000_000
"""An answer that waits for longer is told: the disk may hang."""

MAX_WAIT_NS: Final = 10_000_000_000
"""After this time the answer is that nothing has been saved so far."""


class Withheld(NamedTuple):
    """A request whose answer waits for the disk."""

    asked: Asked
    answer: Answer
    ticket: Ticket
    since_ns: int


class SavedReplies:
    """Replies to requests: at once, or as soon as a file is written or could not be.

    What an answer vouches for is in force meanwhile.
    """

    def __init__(self, vehicle: Vehicle) -> None:
        self._vehicle = vehicle
        self._withheld: list[Withheld] = []
        self._told_slow = False

    def reply(self, asked: Asked, request: Message, answer: Answer, now_ns: int) -> None:
        """Answer a request. Those beyond a bound are to ask again."""
        ticket = self._vehicle.saving(request, answer)
        if ticket is None or not ticket.is_open:
            asked.reply(answer)
        elif len(self._withheld) < MAX_WITHHELD:
            self._withheld.append(Withheld(asked, answer, ticket, now_ns))
        else:
            asked.reply(refusal(reasons.TOO_MANY_REQUESTS, result=AckResult.TEMPORARILY_REJECTED))

    def settle(self, now_ns: int) -> None:
        """Send the answers whose files have been written meanwhile."""
        self._vehicle.collect_saved()
        withheld, self._withheld = self._withheld, []
        for one in withheld:
            if not one.ticket.is_open:
                one.asked.reply(once_saved(one.answer, one.ticket))
            elif now_ns - one.since_ns > MAX_WAIT_NS:
                one.asked.reply(not_saved(one.answer))
            else:
                self._withheld.append(one)
        self._tell_slow(now_ns)

    def _tell_slow(self, now_ns: int) -> None:
        """Say once that a file is not being written."""
        since_ns = min((one.since_ns for one in self._withheld), default=now_ns)
        is_slow = now_ns - since_ns > SLOW_NS
        if is_slow and not self._told_slow:
            self._vehicle.say(Severity.WARNING, "not saved for 3 s: the disk is slow, or it hangs")
        self._told_slow = is_slow
