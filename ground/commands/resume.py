"""`resume`: continue to the goal."""

from ground.client.outcomes import Answer, Refused
from ground.client.session import Session
from ground.commands.command import command
from ground.commands.plain import Parts, PlainCommand
from ground.commands.resuming import go_on
from protocol.wire.enums import Command
from protocol.wire.reasons import Reason
from runtime.cli.verb import DRIVE


@command(DRIVE, 60, "resume", moves=True, begins=True)
class Resume(PlainCommand):
    """Continue to the goal.

    Also to one that a failsafe, an emergency stop or an abort ended.
    """

    effect = "driving on"
    parts = Parts(Command.DO_PAUSE_CONTINUE, 1.0)

    def perform(self, session: Session) -> Answer:
        """Continue a kept goal; else drive on to the one that the robot's status shows as lost."""
        answer = PlainCommand.perform(self, session)
        if isinstance(answer, Refused) and answer.reason == Reason.NO_GOAL:
            return go_on(session, answer)
        return answer
