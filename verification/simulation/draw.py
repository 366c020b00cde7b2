"""Draw a scenario from a seed."""

from random import Random
from typing import Final

from runtime.units import NS_PER_MS, NS_PER_S
from verification.simulation.actions import OPERATORS, STATION, draw_driving, draw_operate
from verification.simulation.events import Event, EventScenario
from verification.simulation.faults import FAULTS

DURATION_NS: Final = 20 * NS_PER_S
BOOT_NS: Final = 300 * NS_PER_MS
BY_STATION: Final = 0.12
"""Share of seeds whose first operator uses the ground station."""

PRESSED: Final = {"come": 0.0, "operate": 0.0, "attack": 0.5}
"""Share of events of a kind that are followed by an emergency stop; of other kinds, a tenth."""

SETS_OFF: Final = 0.7
"""Share of seeds in which an operator begins by driving."""

QUIET: Final = 0.1
"""Share of seeds without any fault."""


def draw_scenario(seed: int, duration_ns: int = DURATION_NS) -> EventScenario:
    """Return the scenario of a seed: operators that start and act, and faults meanwhile."""
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
    return EventScenario(seed, duration_ns, tuple(sorted(events)))


def _stop_under(random: Random, event: Event, first: str) -> list[Event]:
    """Return an emergency stop soon after an event, at times."""
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
