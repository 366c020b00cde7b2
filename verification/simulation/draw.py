"""From a seed to a scenario."""

from random import Random
from typing import Final

from runtime.units import NS_PER_MS, NS_PER_S
from verification.simulation.actions import OPERATORS, STATION, draw_driving, draw_operate
from verification.simulation.events import Event, Scenario
from verification.simulation.faults import FAULTS

DURATION_NS: Final = 20 * NS_PER_S
BOOT_NS: Final = 300 * NS_PER_MS
BY_STATION: Final = 0.12
"""In this share of all seeds the first operator uses the ground station."""

PRESSED: Final = {"come": 0.0, "operate": 0.0, "attack": 0.5}
"""In this share of all events of a kind the stop is pressed soon after it, else in a tenth."""

SETS_OFF: Final = 0.7
"""In this share of all seeds an operator begins by driving."""

QUIET: Final = 0.1
"""This share of all seeds has no fault at all."""


def drawn(seed: int, duration_ns: int = DURATION_NS) -> Scenario:
    """The scenario of a seed: operators who come and act, and what goes wrong meanwhile."""
    random = Random(f"scenario {seed}")
    first = STATION if random.random() < BY_STATION else OPERATORS[0]
    events = [Event(BOOT_NS, "come", (first, random.randrange(2)), random.getrandbits(32))]
    for name, share in (("operator-b", 0.4), ("operator-c", 0.15)):
        if random.random() < share:
            events.append(_event(random, "come", (name, random.randrange(2)), duration_ns))
    if random.random() < SETS_OFF:
        at_ns = BOOT_NS + round(random.uniform(0.1, 4.0) * 1000) * NS_PER_MS
        driving = (first, *draw_driving(random))
        events.append(Event(at_ns, "operate", driving, random.getrandbits(32)))
    kinds = ["operate"] * random.randint(3, 9)
    if random.random() >= QUIET:
        weights = [fault.weight for fault in FAULTS.values()]
        kinds += random.choices(tuple(FAULTS), weights, k=random.randint(1, 5))
    for kind in kinds:
        action = draw_operate(random, first) if kind == "operate" else None
        events.append(_event(random, kind, action, duration_ns))
    events += [stop for event in events for stop in _stop_under(random, event, first)]
    return Scenario(seed, duration_ns, tuple(sorted(events)))


def _stop_under(random: Random, event: Event, first: str) -> list[Event]:
    """At times somebody presses the stop while something goes wrong."""
    share = PRESSED.get(event.kind, 0.1)
    if random.random() >= share:
        return []
    time_ns = event.time_ns + random.randrange(800) * NS_PER_MS
    return [Event(time_ns, "operate", (first, "stop"), random.getrandbits(32))]


def _event(
    random: Random, kind: str, arguments: tuple[int | float | str, ...] | None, duration_ns: int
) -> Event:
    time_ns = (
        BOOT_NS + round(random.random() * (duration_ns - 2 * NS_PER_S) / NS_PER_MS) * NS_PER_MS
    )
    if arguments is None:
        arguments = FAULTS[kind].draw(random)
    return Event(time_ns, kind, arguments, random.getrandbits(32))
