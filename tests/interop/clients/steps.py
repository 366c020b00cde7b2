"""The steps of a scenario: each prints its result and time as a line of JSON."""

import json
import os
import sys
import time
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from signal import ITIMER_REAL, SIGALRM, setitimer, signal
from threading import Event
from typing import Final, NoReturn

STEPS: Final = (
    "connect",
    "parameters",
    "home",
    "set_parameter",
    "fence",
    "log",
    "upload",
    "start",
    "pause",
    "complete",
    "goto",
    "mode",
    "stop",
)
"""The steps of each client, in this order."""
STEP_S: Final = 120.0
PATIENCE_S: Final = 60.0
"""How long a condition may take on a busy machine, on which the robot drives in slow motion."""
LONG_S: Final = 90.0
"""Of a drive, or of many requests one after the other."""
POLL_S: Final = 0.02
FRAMES: Final = -4


class StepError(Exception):
    """A failure of a step; the text describes the missing result."""


class TooLateError(Exception):
    """A step has not ended in its time; it is not tried again."""


class Steps:
    """Reports the steps to standard output, and ends the process with their result."""

    def __init__(self, client: str) -> None:
        self._client = client
        self._failed: list[str] = []
        self._notes: list[str] = []
        signal(SIGALRM, self._too_late)

    @contextmanager
    def step(self, name: str, *, is_needed: bool = False) -> Iterator[None]:
        """Run a step. After the failure of one that is needed the scenario ends."""
        self._print({"begins": name})
        self._notes = []
        began_s = time.monotonic()
        error = ""
        setitimer(ITIMER_REAL, STEP_S)
        try:
            yield
        except Exception as failure:
            where = traceback.extract_tb(failure.__traceback__)[FRAMES:]
            lines = " < ".join(f"{one.name}:{one.lineno}" for one in reversed(where))
            error = f"{type(failure).__name__}: {failure} ({lines})"
            self._failed.append(name)
        finally:
            setitimer(ITIMER_REAL, 0)
        took_s = round(time.monotonic() - began_s, 3)
        result = {"step": name, "passed": not error, "seconds": took_s, "notes": self._notes}
        self._print(result | ({"error": error} if error else {}))
        if error and is_needed:
            self.end()

    def note(self, text: str) -> None:
        """Add an observation to the result of the step."""
        self._notes.append(text)

    def end(self) -> NoReturn:
        """End the process; its code says whether all steps have passed."""
        sys.stdout.flush()
        sys.exit(1 if self._failed else 0)

    def _too_late(self, *_: object) -> None:
        raise TooLateError(f"the step has not ended within {STEP_S:g} s")

    def _print(self, fields: dict[str, object]) -> None:
        # In one piece on a line of its own: MAVSDK prints pieces of lines from other threads.
        sys.stdout.flush()
        os.write(
            sys.stdout.fileno(), f"\n{json.dumps({'client': self._client, **fields})}\n".encode()
        )


def pause() -> None:
    """Wait between two checks of a condition."""
    Event().wait(POLL_S)


def until(
    condition: Callable[[], object],
    what: str,
    within_s: float = PATIENCE_S,
    look: Callable[[], object] = pause,
) -> None:
    """Wait for a condition; StepError with `what` when it does not hold in time."""
    deadline_s = time.monotonic() + within_s
    while not condition():
        if time.monotonic() > deadline_s:
            raise StepError(f"not within {within_s:g} s: {what}")
        look()


def repeat(
    act: Callable[[], object],
    condition: Callable[[], object],
    what: str,
    *,
    every_s: float = 1.5,
    within_s: float = PATIENCE_S,
    look: Callable[[], object] = pause,
) -> int:
    """Repeat an action until it has an effect, as an operator on a lossy line does; return the
    number of attempts."""
    count, deadline_s = 0, time.monotonic() + within_s
    while not (count and condition()):
        if count and time.monotonic() >= deadline_s:
            raise StepError(f"not within {within_s:g} s and {count} tries: {what}")
        act()
        count += 1
        next_s = min(deadline_s, time.monotonic() + every_s)
        while not condition() and time.monotonic() < next_s:
            look()
    return count
