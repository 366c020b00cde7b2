"""Scenarios as data: the same list of events gives the same run."""

from typing import Final, NamedTuple, TypeAlias

import msgspec

from runtime.units import NS_PER_MS

Argument: TypeAlias = int | float | str

STATION: Final = "station"
"""The operator that uses the ground station instead of the command line."""

OPERATORS: Final = ("operator-a", "operator-b", "operator-c", STATION)


class Event(NamedTuple):
    """An event at a time; `salt` seeds what the event draws itself."""

    time_ns: int
    kind: str
    arguments: tuple[Argument, ...]
    salt: int

    def __str__(self) -> str:
        words = " ".join(str(argument) for argument in self.arguments)
        return f"{self.time_ns / NS_PER_MS:9.1f} ms  {self.kind} {words}".rstrip()


class EventScenario(NamedTuple):
    """Everything that a run depends on: the seed of its setting, its duration and its events.

    In lockstep the plant's clock drives the robot.
    """

    seed: int
    duration_ns: int
    events: tuple[Event, ...]
    lockstep: bool = False


def to_json(scenario: EventScenario) -> str:
    """Return a scenario as JSON."""
    return msgspec.json.encode(scenario).decode()


def from_json(text: str) -> EventScenario:
    """Read a scenario; msgspec.ValidationError if the text is no scenario."""
    return msgspec.json.decode(text, type=EventScenario)
