"""From a seed to a scenario."""

from random import Random
from typing import Final

from verification.simulation.actions import draw_driving
from verification.simulation.events import Event, Scenario
from verification.simulation.faults import FAULTS

MS: Final = 1_000_000
SECOND: Final = 1_000 * MS
DURATION_NS: Final = 20 * SECOND
BOOT_NS: Final = 300 * MS
SETS_OFF: Final = 0.7
"""In this share of all seeds an operator begins by driving."""

QUIET: Final = 0.1
"""This share of all seeds has no fault at all."""


def drawn(seed: int, duration_ns: int = DURATION_NS) -> Scenario:
    """The scenario of a seed: operators who come and act, and what goes wrong meanwhile."""
    random = Random(f"scenario {seed}")
    events = [Event(BOOT_NS, "come", ("operator-a", random.randrange(2)), random.getrandbits(32))]
    for name, share in (("operator-b", 0.4), ("operator-c", 0.15)):
        if random.random() < share:
            events.append(_event(random, "come", (name, random.randrange(2)), duration_ns))
    if random.random() < SETS_OFF:
        at_ns = BOOT_NS + round(random.uniform(0.1, 4.0) * 1000) * MS
        driving = ("operator-a", *draw_driving(random))
        events.append(Event(at_ns, "operate", driving, random.getrandbits(32)))
    kinds = ["operate"] * random.randint(3, 9)
    if random.random() >= QUIET:
        weights = [fault.weight for fault in FAULTS.values()]
        kinds += random.choices(tuple(FAULTS), weights, k=random.randint(1, 5))
    events += [_event(random, kind, None, duration_ns) for kind in kinds]
    return Scenario(seed, duration_ns, tuple(sorted(events)))


def _event(
    random: Random, kind: str, arguments: tuple[int | float | str, ...] | None, duration_ns: int
) -> Event:
    time_ns = BOOT_NS + round(random.random() * (duration_ns - 2 * SECOND) / MS) * MS
    drawn_now = FAULTS[kind].draw(random)
    return Event(time_ns, kind, arguments or drawn_now, random.getrandbits(32))
