"""`rec mark`: add a remark to the recording."""

from typing import Final

from ground.client.outcomes import Marked
from ground.client.session import Session
from ground.commands.command import OperatorCommand, command, place
from protocol.topics import MARK
from protocol.wire.enums import Severity
from protocol.wire.statustext import pieces_of
from runtime.cli.verb import REC

MARK_PATIENCE_S: Final = 0.5


@command(REC, 30, "rec mark the door is closed now", moves=True, seizes=False)
class Mark(OperatorCommand):
    """Add a remark to the recording.

    Recorders write it, and a replay stops there.
    """

    remark: str = place("TEXT", "the remark", joined=" ".join)

    def perform(self, session: Session) -> Marked:
        """Publish the remark if a recorder is subscribed to it."""
        link = session.link
        publisher = link.bus.publisher(MARK, link.robot)
        has_recorder = not link.bus.await_matched([publisher], timeout_s=MARK_PATIENCE_S)
        if has_recorder:
            for piece in pieces_of(self.remark, link.ids.next() & 0xFFFF or 1, Severity.NOTICE):
                publisher.put(piece)
        return Marked(self.remark, has_recorder)
