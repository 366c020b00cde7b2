"""The context of an operation: the link, the progress display, and whether another part attends."""

from collections.abc import Callable

from ground.client.floor import Floor
from ground.client.link import Link
from ground.client.outcomes import NoProgress, Progress


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
