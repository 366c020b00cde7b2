"""Withhold answers until the files they depend on are written."""

from typing import Final, NamedTuple

from protocol.bus.services import ServiceRequest, refusal
from protocol.wire.enums import AckResult, Severity
from protocol.wire.message import Message
from protocol.wire.messages import CommandAck
from robot.core import reasons
from robot.storage.writer import StateFile, Ticket
from robot.vehicle import Answer, Vehicle, not_saved, once_saved
from runtime.units import NS_PER_S

MAX_WITHHELD: Final = 64
INTERIM_NS: Final = 300_000_000
"""After this time the answer is IN_PROGRESS: in force, being saved, repeat the request."""

SLOW_NS: Final = 3_000_000_000
"""Warn about a write that takes longer: the disk may hang."""

SLOW: Final = f"not saved for {SLOW_NS // NS_PER_S} s: the disk is slow, or it hangs"

MAX_WAIT_NS: Final = 10_000_000_000
"""After this time the answer is that nothing has been saved."""

SAVING: Final = CommandAck(command=0, result=AckResult.IN_PROGRESS, result_param2=reasons.OK)


class WithheldReply(NamedTuple):
    """A request whose answer waits for a file."""

    incoming: ServiceRequest
    answer: Answer
    ticket: Ticket
    since_ns: int


class SavedReplies:
    """Sends replies as soon as the file they depend on is written, or has failed.

    Meanwhile the requested change is already in force.
    """

    def __init__(self, vehicle: Vehicle) -> None:
        self._vehicle = vehicle
        self._withheld: list[WithheldReply] = []
        self._stalled: dict[StateFile, tuple[int, int]] = {}
        """Files being written: the newest ended write, and the time of the last progress."""
        self._warned_slow = False

    def reply(
        self, incoming: ServiceRequest, request: Message, answer: Answer, now_ns: int
    ) -> None:
        """Answer a request now or when its file is written; refuse it beyond a limit."""
        ticket = self._vehicle.saving(request, answer)
        if ticket is None or not ticket.is_open:
            incoming.reply(answer)
        elif len(self._withheld) < MAX_WITHHELD:
            self._stalled.setdefault(ticket.file, (ticket.file.ended, now_ns))
            self._withheld.append(WithheldReply(incoming, answer, ticket, now_ns))
        else:
            incoming.reply(
                refusal(reasons.TOO_MANY_REQUESTS, result=AckResult.TEMPORARILY_REJECTED)
            )

    def settle(self, now_ns: int) -> None:
        """Send the answers whose files are written by now, or have taken too long."""
        self._vehicle.collect_saved()
        self._watch(now_ns)
        withheld, self._withheld = self._withheld, []
        for one in withheld:
            if not one.ticket.is_open:
                one.incoming.reply(once_saved(one.answer, one.ticket))
            elif self._stalled_ns(one.ticket.file, now_ns) > MAX_WAIT_NS:
                one.incoming.reply(not_saved(one.answer))
            elif now_ns - one.since_ns > INTERIM_NS:
                one.incoming.reply(SAVING)
            else:
                self._withheld.append(one)

    def _watch(self, now_ns: int) -> None:
        """Track the progress of each file; warn once if a file makes none."""
        for file, (ended, _) in tuple(self._stalled.items()):
            if not file.ticket.is_open:
                del self._stalled[file]
            elif file.ended != ended:
                self._stalled[file] = file.ended, now_ns
        is_slow = any(self._stalled_ns(file, now_ns) > SLOW_NS for file in self._stalled)
        if is_slow and not self._warned_slow:
            self._vehicle.announce(Severity.WARNING, SLOW)
        self._warned_slow = is_slow

    def _stalled_ns(self, file: StateFile, now_ns: int) -> int:
        return now_ns - self._stalled[file][1]
