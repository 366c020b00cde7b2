"""What is asked of the robot, in threads of their own: one request at a time, and the e-stop."""

from collections.abc import Callable
from typing import NamedTuple, TypeAlias


class Outcome(NamedTuple):
    """How a request ended, in one or more lines: `ok 14 ms`, or the robot's reason."""

    ok: bool
    text: str


Job: TypeAlias = Callable[[], Outcome]
