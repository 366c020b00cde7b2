"""Start the app on a terminal of a given size."""

import os
import signal
import termios
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final

from checks.harness.observer import Observer
from checks.harness.terminal import CHUNK, SLOW_READ_S, Terminal

SIZES: Final = ((80, 24), (140, 40))
READY: Final = "read: ready"
REPLAYING: Final = "REPLAY"
RECORDINGS: Final = Path("sidestep") / "recordings"
PATIENCE_S: Final = 30.0


class AdjustableTerminal(Terminal):
    """A terminal whose size and speed change while the app runs, which is not started again."""

    def resize(self, size: tuple[int, int]) -> None:
        """Set the size in columns and rows, and notify the app as a terminal emulator does."""
        columns, rows = size
        termios.tcsetwinsize(self._end, (rows, columns))
        os.kill(self.pid, signal.SIGWINCH)  # it is not the terminal's controlling process

    @contextmanager
    def slow(self, most_per_s: int) -> Iterator[None]:
        """Read at most so many bytes a second until the block ends."""
        self._pause_s, self._chunk = SLOW_READ_S, max(1, round(most_per_s * SLOW_READ_S))
        try:
            yield
        finally:
            self._pause_s, self._chunk = 0.0, CHUNK


@contextmanager
def on_terminal(
    observer: Observer,
    size: tuple[int, int],
    *,
    bytecode: Path | None = None,
) -> Iterator[AdjustableTerminal]:
    """Start `sidestep ground` with a state folder of its own.

    With `bytecode` compiled modules are kept there, as in an installation.
    """
    words = ("ground", "--id", observer.robot, "--connect", observer.endpoint)
    environment = {"XDG_STATE_HOME": str(observer.folder)}
    if bytecode is not None:
        environment["PYTHONPYCACHEPREFIX"] = str(bytecode)
    with AdjustableTerminal(words, size, environment) as terminal:
        yield terminal


@contextmanager
def commanding(observer: Observer, size: tuple[int, int]) -> Iterator[AdjustableTerminal]:
    """Start the app and wait until it has read all that it needs."""
    with on_terminal(observer, size) as terminal:
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
