"""The context of an operation: the link, the progress display, and whether another part attends."""

from collections.abc import Callable, Coroutine
from dataclasses import replace
from typing import Any, Final, Protocol, TypeVar

from ground.client.floor import Floor
from ground.client.lease_holder import holder_name, is_ours
from ground.client.link import Link
from ground.client.outcomes import Accepted, Answer, NoProgress, Outcome, Progress
from protocol.topics import LEASE
from protocol.wire.messages import LeaseStatus
from protocol.wire.reasons import Reason

O_co = TypeVar("O_co", bound=Outcome, covariant=True)
LEASE_NS: Final = 1_500_000_000


class Session:
    """The work of one operator with one robot.

    `attended`: another part of this process holds the lease, sends the operator's heartbeat and
    watches the goal. An operation then ends with the robot's answer. Otherwise it does all of this
    itself, until it ends. `floor` returns the floor of the world, if it is known.
    """

    def __init__(
        self,
        link: Link,
        progress: Progress | None = None,
        *,
        attended: bool = False,
        floor: Callable[[], Floor | None] = lambda: None,
    ) -> None:
        self.link = link
        self.progress: Progress = progress or NoProgress()
        self.attended = attended
        self.floor = floor

    def with_holder(self, answer: Answer, known: LeaseStatus | None = None) -> Answer:
        """Return an answer; a refusal for the lease gets the lease holder's name.

        `known` is a lease status that has just arrived; without one the next is waited for.
        """
        if isinstance(answer, Accepted):
            return answer
        return replace(answer, holder=refusing_holder(self.link, answer.reason, known))


class Operation(Protocol[O_co]):
    """Something that an operator can do with a robot."""

    @property
    def verb(self) -> str:
        """The name of the operation on the command line."""

    @property
    def moves(self) -> bool:
        """True if it can move the robot or change how it moves."""

    def perform(self, on: Any, /) -> O_co | Coroutine[Any, Any, O_co]:
        """Carry it out, on a session or on a robot, and return the outcome.

        Raises UserError, RemoteError or UnansweredError if there is no outcome.
        """


def refusing_holder(link: Link, reason: int, known: LeaseStatus | None = None) -> str:
    """Return the name of the lease holder if `reason` is that another one holds it, else "".

    The lease may have passed to this person since, who then is not the other one.
    """
    if reason != Reason.LEASE_HELD:
        return ""
    found = known if known is not None and known.held else link.newest(LEASE, LEASE_NS)
    if found is None or not found.held or is_ours(found, link.bus.operator):
        return ""
    return holder_name(found)
