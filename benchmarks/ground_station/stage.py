"""Start the app on a terminal of a given size."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final

from verification.harness.observer import Observer
from verification.harness.terminal import Terminal

SIZES: Final = ((80, 24), (140, 40))
READY: Final = "read: ready"
REPLAYING: Final = "REPLAY"
RECORDINGS: Final = Path("sidestep") / "recordings"
PATIENCE_S: Final = 30.0


@contextmanager
def on_terminal(
    observer: Observer,
    size: tuple[int, int],
    *,
    most_per_s: int | None = None,
    bytecode: Path | None = None,
) -> Iterator[Terminal]:
    """Start `sidestep ground` with a state folder of its own.

    With `bytecode` compiled modules are kept there, as in an installation.
    """
    words = ("ground", "--id", observer.robot, "--connect", observer.endpoint)
    environment = {"XDG_STATE_HOME": str(observer.folder)}
    if bytecode is not None:
        environment["PYTHONPYCACHEPREFIX"] = str(bytecode)
    with Terminal(words, size, environment, most_per_s=most_per_s) as terminal:
        yield terminal


@contextmanager
def commanding(
    observer: Observer, size: tuple[int, int], *, most_per_s: int | None = None
) -> Iterator[Terminal]:
    """Start the app and wait until it has read all that it needs."""
    with on_terminal(observer, size, most_per_s=most_per_s) as terminal:
        terminal.shown(READY, PATIENCE_S)
        yield terminal


@contextmanager
def replaying(observer: Observer, size: tuple[int, int]) -> Iterator[Terminal]:
    """Show the latest recording without playing it."""
    path = max((observer.folder / RECORDINGS).glob("*.mcap"), key=lambda path: path.stat().st_size)
    environment = {"XDG_STATE_HOME": str(observer.folder)}
    with Terminal(("replay", str(path)), size, environment) as terminal:
        terminal.shown(REPLAYING, PATIENCE_S)
        yield terminal
