"""Zenoh's threads: few of them, and callbacks that keep their Python state.

By default Zenoh uses a thread that polls the sockets, two that receive and one that sends. Each
received batch is then handed from one thread to another, which costs more than to process it. Here
one thread polls and receives, so a callback runs in the thread that has read the socket. The sender
remains a thread of its own: it keeps the links alive even while a callback waits.
"""

import ctypes
import os
import threading
from collections.abc import Callable
from typing import Final, TypeVar

from zenoh.handlers import Callback

VARIABLE: Final = "ZENOH_RUNTIME"
RUNTIMES: Final = (
    "(rx: (handover: app), acc: (handover: app), net: (handover: app), app: (worker_threads: 1))"
)
"""Zenoh reads this variable of the environment when the first session is opened."""

T = TypeVar("T")


class ThreadState(threading.local):
    """Whether the Python state of the calling thread is kept."""

    kept = False


STATE: Final = ThreadState()


def use_few_threads() -> None:
    """Configure Zenoh's threads, unless the environment does; call it before the first session."""
    os.environ.setdefault(VARIABLE, RUNTIMES)


def direct(receive: Callable[[T], object]) -> "Callback[T]":
    """Return a handler that calls `receive` in Zenoh's receive thread.

    Python creates a state for each call from a thread that is not its own, and deletes it after the
    call. This maps and unmaps memory, which interrupts the other processors. One reference that is
    never released keeps the state.
    """

    def call(received: T) -> None:
        if not STATE.kept:
            STATE.kept = True
            ctypes.pythonapi.PyGILState_Ensure()
        receive(received)

    return Callback(call, indirect=False)
