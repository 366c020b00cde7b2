"""The only way to give Zenoh a function: what interrupts it is not lost.

Zenoh calls a function in the thread that asks, too: for the tokens and links that are there when a
listener is declared, for own publications and for own replies. It logs an exception of the function
and goes on. A ctrl+c that arrives meanwhile would be lost there, and the program would drive on.

Python makes a state for each call from a thread that it does not know, and destroys it afterwards:
it maps and unmaps the stack of its frames, in three system calls and a page fault. The state of a
thread that calls is kept instead.
"""

import ctypes
from collections.abc import Callable
from threading import get_ident
from typing import Final, TypeVar

from zenoh.handlers import Callback

T = TypeVar("T")


class _Unraisable:
    """Hands an exception to `sys.unraisablehook`: what a finalizer raises goes there."""

    def __init__(self, error: BaseException) -> None:
        self._error = error

    def __del__(self) -> None:
        raise self._error


def zenoh_callback(
    function: Callable[[T], object], drop: Callable[[], object] | None = None
) -> "Callback[T]":
    """Return a function as Zenoh calls it, and `drop` for the end of its calls.

    `sys.unraisablehook` gets what interrupts them; the command line sends the signal again.
    """
    ended = None if drop is None else keep_interrupts_out(drop)
    return Callback(keep_interrupts_out(function), ended, indirect=False)


MAX_STATES: Final = 64
"""Threads whose state is kept: it stays when a thread ends, and Zenoh may start others."""

STATES: Final[set[int]] = set()


def keep_state(thread: int) -> None:
    """Let Python keep its state of the calling thread, whose id is `thread`."""
    if len(STATES) < MAX_STATES:
        STATES.add(thread)
        ctypes.pythonapi.PyGILState_Ensure()  # no Release: its count of users stays above 0


def keep_interrupts_out(function: Callable[..., object]) -> Callable[..., None]:
    """Return a function that lets no ctrl+c get into Zenoh."""

    def call(*values: object) -> None:
        if (thread := get_ident()) not in STATES:
            keep_state(thread)
        try:
            function(*values)
        except KeyboardInterrupt as error:
            _Unraisable(error)

    return call
