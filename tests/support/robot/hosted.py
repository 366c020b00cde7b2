"""Start a hosted board: a child process at the other end of a socket."""

import os
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager

from firmware.board import Board, SerialLine
from tests.support.robot import hosted_loop

PATIENCE_S = 20.0


class Hosted:
    """A running hosted board; `line` is the host's end of its serial line."""

    def __init__(self, which: str = "") -> None:
        ours, theirs = socket.socketpair()
        descriptor = ours.detach()
        self.line = SerialLine(descriptor, os.dup(descriptor), self._is_alive)
        words = [sys.executable, "-m", hosted_loop.__name__, str(theirs.fileno()), which]
        self._process = subprocess.Popen(words, pass_fds=[theirs.fileno()])
        theirs.close()

    def _is_alive(self) -> bool:
        return self._process.poll() is None

    def suspend(self) -> None:
        """Stop the board without ending it."""
        self._process.send_signal(signal.SIGSTOP)

    def kill(self) -> None:
        """End the board and wait for its end."""
        self._process.kill()
        self._process.wait()

    def close(self) -> None:
        """End the board."""
        self.line.close()
        self._process.kill()
        self._process.wait()


@contextmanager
def hosted_board(patience_s: float = PATIENCE_S, which: str = "") -> Iterator[tuple[Board, Hosted]]:
    """Return a board that has said hello, and its process."""
    hosted = Hosted(which)
    try:
        board = Board(hosted.line, patience_s)
        board.wait_for_hello()
        yield board, hosted
    finally:
        hosted.close()
