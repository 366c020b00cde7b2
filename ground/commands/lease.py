"""The lease: one operator at a time commands the robot; any operator may stop it.

A lease belongs to a person: the programs of one user on one computer, or of one certificate, share
it. It ends when they are silent, or when nothing has been driven for a while.
"""

from typing import Any, Final

from ground.client.lease_holder import operator_name
from ground.client.outcomes import Answer, LeaseShown
from ground.commands.command import OperatorCommand, choice, command, option, parsed, seconds
from ground.robot import Robot
from protocol.wire.enums import LeaseAction
from protocol.wire.limits import MAX_LEASE_MS
from runtime.cli.verb import MORE

IDLE_S: Final = MAX_LEASE_MS // 1000
SHOW: Final = "show"
ACTIONS: Final = {
    "take": LeaseAction.TAKE,
    "release": LeaseAction.RELEASE,
    "seize": LeaseAction.SEIZE,
    SHOW: SHOW,
}


@command(MORE, 50, "lease take --for 60", moves=True)
class ChangeLease(OperatorCommand):
    """Take or give back control of the robot, or show who has it.

    The robot takes it back when nothing has been driven for IDLE_S. With `for_s` a program that
    commands the robot alone keeps it for this time, or until it is interrupted.
    """

    action: LeaseAction = choice(
        ACTIONS,
        parse=str,
        help="take is refused while another person holds it; the robot takes it back when nothing"
        f" has been driven for {IDLE_S} s",
    )
    name: str | None = option(
        "--name",
        default=None,
        metavar="N",
        help="name shown to other operators (default user@host:terminal)",
    )
    for_s: float | None = option(
        "--for", default=None, parse=seconds, metavar="S", help="keep it for this time"
    )

    @property
    def verb(self) -> str:
        """The verb, with the action."""
        return f"lease {self.action.name.lower()}"

    @classmethod
    def parsed(cls, found: Any) -> OperatorCommand:
        """Return the command for parsed arguments; UserError for a value out of range."""
        return ShowLease() if found.action == SHOW else parsed(cls, found)

    async def perform(self, robot: Robot) -> Answer:
        """Change the lease; keep it unless another part of the process does."""
        name = operator_name(self.name)
        answer = await robot.lease.change(self.action, name)
        if not answer.ok or self.action is LeaseAction.RELEASE or not robot.follows:
            return answer
        if self.for_s is None:
            note = f"begin to drive within {IDLE_S} s, or the robot takes the lease back"
            robot.progress.note(f"{name} commands {robot.name}; {note}")
            return answer
        robot.progress.note(f"{name} commands {robot.name}; Ctrl-C gives the lease back")
        return await robot.lease.keep(self.for_s, name) or answer


@command(word="lease show")
class ShowLease(OperatorCommand):
    """Read which operator holds the lease."""

    async def perform(self, robot: Robot) -> LeaseShown:
        """Return the lease; RemoteError if the robot publishes no lease status."""
        return await robot.lease.show()
