"""The context of an operation: the link, the progress display, and whether another part attends."""

from collections.abc import Callable, Coroutine
from typing import Any, Protocol, TypeVar

from ground.client.floor import Floor
from ground.client.link import Link
from ground.client.outcomes import NoProgress, Outcome, Progress

O_co = TypeVar("O_co", bound=Outcome, covariant=True)


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
