"""The ground station's app on a terminal of some size, as the parts of its benchmark open it."""

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Final

from benchmarks.observed import Observer
from benchmarks.terminal import Terminal

SIZES: Final = ((80, 24), (140, 40))
READY: Final = "read: ready"
PATIENCE_S: Final = 30.0


@contextmanager
def on_terminal(
    observer: Observer, size: tuple[int, int], *, most_per_s: int | None = None
) -> Iterator[Terminal]:
    """`sidestep ground`, as it starts; it leaves nothing in the user's own folder."""
    words = ("ground", "--id", observer.robot, "--connect", observer.endpoint)
    with (
        tempfile.TemporaryDirectory() as state,
        Terminal(words, size, {"XDG_STATE_HOME": state}, most_per_s=most_per_s) as terminal,
    ):
        yield terminal


@contextmanager
def commanding(
    observer: Observer, size: tuple[int, int], *, most_per_s: int | None = None
) -> Iterator[Terminal]:
    """The same, when it has read all that it needs."""
    with on_terminal(observer, size, most_per_s=most_per_s) as terminal:
        terminal.shown(READY, PATIENCE_S)
        yield terminal
