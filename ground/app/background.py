"""Run slow jobs in daemon threads, so that neither the screen nor the exit waits for them."""

from collections.abc import Callable
from queue import Empty, SimpleQueue
from threading import Thread
from typing import TypeVar

from runtime.errors import LocalError, RemoteError

T = TypeVar("T")


class BackgroundJobs:
    """Runs jobs in threads and hands their results over in the thread that polls."""

    def __init__(self, say: Callable[[str], None]) -> None:
        self._note = say
        self._ready: SimpleQueue[Callable[[], None]] = SimpleQueue()

    def begin(self, job: Callable[[], T], done: Callable[[T], None]) -> None:
        """Start a job. `done` gets its result; expected errors go to the log instead."""

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
        """Hand over the results of finished jobs."""
        while True:
            try:
                callback = self._ready.get_nowait()
            except Empty:
                return
            callback()
