"""A scenario as data: what happens when. The same list of events gives the same run."""

from typing import NamedTuple, TypeAlias

import msgspec

from runtime.units import NS_PER_MS

Argument: TypeAlias = int | float | str


class Event(NamedTuple):
    """Something that happens at a time; `salt` is the seed of what it draws in turn."""

    time_ns: int
    kind: str
    arguments: tuple[Argument, ...]
    salt: int

    def __str__(self) -> str:
        words = " ".join(str(argument) for argument in self.arguments)
        return f"{self.time_ns / NS_PER_MS:9.1f} ms  {self.kind} {words}".rstrip()


class Scenario(NamedTuple):
    """All that a run depends on: the seed of its setting, how long it lasts, and its events."""

    seed: int
    duration_ns: int
    events: tuple[Event, ...]


def to_json(scenario: Scenario) -> str:
    return msgspec.json.encode(scenario).decode()


def from_json(text: str) -> Scenario:
    """Raises msgspec.ValidationError for text that is no scenario."""
    return msgspec.json.decode(text, type=Scenario)
