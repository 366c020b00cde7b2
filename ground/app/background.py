"""Slow work beside the screen: in threads that nobody has to wait for, not even at the end."""

from collections.abc import Callable
from queue import Empty, SimpleQueue
from threading import Thread
from typing import TypeVar

from runtime.errors import LocalError, RemoteError

T = TypeVar("T")


class BackgroundJobs:
    """What comes of a job is handed over at `poll`, in the thread that polls."""

    def __init__(self, say: Callable[[str], None]) -> None:
        self._note = say
        self._ready: SimpleQueue[Callable[[], None]] = SimpleQueue()

    def begin(self, job: Callable[[], T], done: Callable[[T], None]) -> None:
        """`done` gets the result; an error that is meant for people is said instead."""

        def work() -> None:
            try:
                found = job()
            except (LocalError, RemoteError, OSError) as error:
                words = str(error)
                self._ready.put(lambda: self._note(words))
                return
            self._ready.put(lambda: done(found))

        Thread(target=work, daemon=True).start()

    def poll(self) -> None:
        while True:
            try:
                hand_over = self._ready.get_nowait()
            except Empty:
                return
            hand_over()
