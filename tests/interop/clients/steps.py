"""Steps of a scenario, the positions to which clients drive, and arguments of their scripts."""

import argparse
import json
import os
import sys
import time
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from math import cos, hypot, radians
from pathlib import Path
from signal import ITIMER_REAL, SIGALRM, setitimer, signal
from struct import pack, unpack
from threading import Event
from typing import Final, NamedTuple, NoReturn

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


METRES_PER_DEG: Final = 111_319.490793
"""Of latitude, on a sphere with the earth's equatorial radius."""
NEAR_M: Final = 0.25
PARAMETER: Final = "V_MAX_M_S"
VALUE: Final = 0.375
"""The value that clients set; exact in 32 bits."""
FLIGHT_TERMINATION: Final = 185
EMERGENCY: Final = 6
"""MAV_STATE_EMERGENCY."""


class Place(NamedTuple):
    """Latitude and longitude in degrees."""

    latitude: float
    longitude: float

    def moved(self, north_m: float, east_m: float) -> "Place":
        """Return the place so many metres away."""
        east_deg = east_m / (METRES_PER_DEG * cos(radians(self.latitude)))
        return Place(self.latitude + north_m / METRES_PER_DEG, self.longitude + east_deg)

    def distance_m(self, other: "Place") -> float:
        """Return the distance of two near places."""
        north_m = (other.latitude - self.latitude) * METRES_PER_DEG
        east_m = (other.longitude - self.longitude) * METRES_PER_DEG
        return hypot(north_m, east_m * cos(radians(self.latitude)))

    def rounded(self) -> "Place":
        """Return the nearest place that 32-bit floats can carry: up to a metre away."""
        return Place(*unpack("<2f", pack("<2f", *self)))

    def is_near(self, other: "Place") -> bool:
        """Return whether a robot that should be there is there."""
        return self.distance_m(other) < NEAR_M


def route(start: Place) -> list[Place]:
    """Return the waypoints of the mission: along the room, and to its side."""
    return [start.moved(0.0, 1.6), start.moved(0.7, 2.6)]


def goal(start: Place) -> Place:
    """Return where the guided goto leads."""
    return start.moved(0.0, 3.4)


def fence(start: Place) -> list[Place]:
    """Return the corners of a fence around the room, in which the robot starts."""
    return [start.moved(n, e) for n, e in ((-1.9, -0.5), (-1.9, 5.2), (1.9, 5.2), (1.9, -0.5))]


class Call(NamedTuple):
    """The arguments of a scenario."""

    host: str
    port: int
    recording: Path
    folder: Path
    transport: str = "udpout"

    @property
    def address(self) -> str:
        """HOST:PORT."""
        return f"{self.host}:{self.port}"

    @property
    def endpoint(self) -> str:
        """The address as pymavlink and programs on top of it have it."""
        return f"{self.transport}:{self.address}"

    def require_recording(self, path: Path) -> None:
        """Compare a downloaded log with the recording of the robot, byte for byte."""
        found, real = path.read_bytes(), self.recording.read_bytes()
        assert found == real, f"the log has {len(found)} bytes, and differs from the recording"


def called() -> Call:
    """Parse the command line."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--host", default="127.0.0.1")
    parser.add_argument("--port", type=int, required=True)
    parser.add_argument("--recording", type=Path, required=True)
    parser.add_argument("--folder", type=Path, required=True)
    parser.add_argument("--transport", choices=("udpout", "udpin", "tcp"), default="udpout")
    return Call(**vars(parser.parse_args()))
