"""Draw a scenario from a seed."""

from collections.abc import Callable
from random import Random
from typing import Final

from checks.simulation.event_kinds import (
    CLIENT_ACTIONS,
    FAULTS,
    Arguments,
    draw_client,
    draw_driving,
    draw_operate,
    place,
    span_ms,
)
from checks.simulation.events import OPERATORS, STATION, Event, EventScenario
from checks.simulation.hosts.mavlink import CLIENTS, GATEWAY
from runtime.units import NS_PER_MS, NS_PER_S

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

FENCED: Final = 0.12
"""Share of seeds that begin with a close fence, and a drive that meets it."""

SEIZED: Final = 0.2
"""Share of manual drives during which another operator seizes the lease."""

RESTARTED: Final = 0.15
"""Share of emergency stops after which the robot is restarted, and then asked to drive."""

UNLINKED: Final = 0.1
"""Share of seeds in which the first operator loses its link, and with it perhaps its place."""

LOCKSTEP: Final = 0.08
"""Share of seeds in lockstep. In each the plant's clock stands still for a while, during which an
emergency stop is pressed."""

GATEWAY_EVERY: Final = 4
"""One seed in so many has a gateway with two clients, unless it is in lockstep. What it draws is
drawn apart, so that all else of the seed stays as it is."""

LEFT_TO_CLIENTS: Final = 0.6
"""Share of these seeds without other operators."""

FOLLOWED: Final[tuple[tuple[str, float, int, Arguments], ...]] = (
    ("drive", 0.3, 4000, ("silence", 8.0)),
    ("target", 0.3, 3000, ("flood", 8)),
    ("steer", 0.3, 1500, ("flood", 8)),
    ("flood", 0.4, 200, ("stop",)),
    ("forge", 0.1, 300, ("stop",)),
    ("clear", 0.3, 100, ("stop",)),
    ("stop", 0.8, 1500, ("clear", 1)),
    ("clear", 0.6, 1000, ("drive", 32.0, 30.0)),
)
"""An action of a client, the share in which another one follows, within how many milliseconds, and
that one. Stops are pressed by either client."""

IN_LOCKSTEP: Final = ("come", "operate", "leave", "kill", "attack", "crossing", "rot")
"""Faults in lockstep; those of links and clocks would hold the plant's clock up as well.

After its wall clock was set back, a robot that restarts counts as an older one for 1 s."""


def draw_scenario(seed: int, duration_ns: int = DURATION_NS) -> EventScenario:
    """Return the scenario of a seed: operators that start and act, and faults meanwhile."""
    random = Random(f"scenario {seed}")
    lockstep = random.random() < LOCKSTEP
    first = STATION if random.random() < BY_STATION else OPERATORS[0]
    events = [Event(BOOT_NS, "come", (first, random.randrange(2)), random.getrandbits(32))]
    for name, share in (("operator-b", 0.4), ("operator-c", 0.15)):
        if random.random() < share:
            events.append(_event(random, "come", (name, random.randrange(2)), duration_ns))
    if random.random() < FENCED:
        events += _fenced(random, first)
    elif random.random() < SETS_OFF:
        events.append(_event(random, "operate", (first, *draw_driving(random)), 6 * NS_PER_S))
    kinds = ["operate"] * random.randint(3, 9)
    if random.random() >= QUIET:
        possible = IN_LOCKSTEP if lockstep else tuple(FAULTS)
        weights = [FAULTS[kind].weight for kind in possible]
        kinds += random.choices(possible, weights, k=random.randint(1, 5))
    for kind in kinds:
        action = draw_operate(random, first) if kind == "operate" else None
        events.append(_event(random, kind, action, duration_ns))
    events += _link(Random(f"links {seed}"), first, duration_ns)
    if lockstep:
        events += _stand(random, first, duration_ns)
    events += [stop for event in events for stop in _stop_under(random, event, first)]
    events += [more for event in events for more in _seizure_under(random, event)]
    events += [more for event in events for more in _restart_under(random, event, first)]
    if seed % GATEWAY_EVERY == GATEWAY_EVERY - 1 and not lockstep:
        events = _with_gateway(Random(f"gateway {seed}"), events, duration_ns)
    return EventScenario(seed, duration_ns, tuple(sorted(events)), lockstep)


def _with_gateway(random: Random, others: list[Event], duration_ns: int) -> list[Event]:
    """Return the events with a gateway, its clients' actions and faults on their way."""
    if random.random() < LEFT_TO_CLIENTS:
        others = [one for one in others if one.kind not in ("come", "operate", "crossing")]
    first = random.choice(tuple(CLIENTS))
    drive = (first, *random.choice(CLIENT_ACTIONS[:3])[1](random))
    events = [_event(random, "client", drive, 6 * NS_PER_S)]
    events += [
        _event(random, "client", draw_client(random), duration_ns)
        for _ in range(random.randint(4, 12))
    ]
    for event in events:  # also those that follow
        name, did = event.arguments[:2]
        for begun, share, within_ms, action in FOLLOWED:
            if did == begun and random.random() < share:
                time_ns = event.time_ns + random.randrange(within_ms) * NS_PER_MS
                who = random.choice(tuple(CLIENTS)) if action == ("stop",) else name
                events.append(Event(time_ns, "client", (who, *action), 0))
    for _ in range(random.choice((0, 0, 1, 2, 3))):
        kind = random.choice(tuple(ON_THE_WAY))
        events.append(_event(random, kind, ON_THE_WAY[kind](random), duration_ns))
    return [Event(BOOT_NS, "gateway", (), 0), *events, *others]


def _links_of_clients(random: Random) -> tuple[str, str]:
    """Draw a direction of a link between a client and the robot."""
    ends = random.choice((*((name, GATEWAY) for name in CLIENTS), (GATEWAY, "robot")))
    return ends if random.randrange(2) else (ends[1], ends[0])


ON_THE_WAY: Final[dict[str, Callable[[Random], Arguments]]] = {
    "rough": lambda random: (*_links_of_clients(random), *FAULTS["rough"].draw(random)[2:]),
    "queue": lambda random: (*_links_of_clients(random), *FAULTS["queue"].draw(random)[2:]),
    "cut": lambda random: (*_links_of_clients(random), *FAULTS["cut"].draw(random)[2:]),
    "kill": lambda random: (GATEWAY, random.choice((100, 300, 1000, 2500))),
    "suspend": lambda random: (random.choice((GATEWAY, *CLIENTS)), span_ms(random)),
    "clock": lambda random: (GATEWAY, *FAULTS["clock"].draw(random)[1:]),
    "link": lambda random: (GATEWAY, *FAULTS["link"].draw(random)[1:]),
}
"""Faults of the gateway, its clients and their links."""


def _link(random: Random, first: str, duration_ns: int) -> list[Event]:
    """Return that the first operator's link breaks, and a stop meanwhile or later, at times."""
    if random.random() >= UNLINKED:
        return []
    broken = _event(random, "link", (first, *FAULTS["link"].draw(random)[1:]), duration_ns)
    time_ns = broken.time_ns + random.randrange(0, 4000) * NS_PER_MS
    return [broken, Event(time_ns, "operate", (first, "stop"), random.getrandbits(32))]


def _fenced(random: Random, first: str) -> list[Event]:
    """Return a close fence and a drive that meets it."""
    at_ns = BOOT_NS + random.randrange(500, 3000) * NS_PER_MS
    fence = (first, "fence", random.choice((0.4, 0.7, 1.1)), random.choice((0, 0, 1)))
    drive = random.choice((("teleop", 0.3, 0.0, 6.0), ("drive", *place(random), "GUIDED")))
    return [
        Event(at_ns, "operate", fence, random.getrandbits(32)),
        Event(at_ns + 1, "operate", (first, *drive), random.getrandbits(32)),
    ]


def _stand(random: Random, first: str, duration_ns: int) -> list[Event]:
    """Return that the plant's clock stands still, and a stop during that."""
    stand = _event(random, "stand", None, duration_ns - 2 * NS_PER_S)
    time_ns = stand.time_ns + random.randrange(50, 500) * NS_PER_MS
    return [stand, Event(time_ns, "operate", (first, "stop"), random.getrandbits(32))]


def _seizure_under(random: Random, event: Event) -> list[Event]:
    """Return that another operator seizes the lease during a manual drive, at times."""
    if event.arguments[1:2] != ("teleop",) or random.random() >= SEIZED:
        return []
    other = random.choice([name for name in OPERATORS[:3] if name != event.arguments[0]])
    time_ns = event.time_ns + random.randrange(100, 1500) * NS_PER_MS
    return [
        Event(time_ns - 100 * NS_PER_MS, "come", (other, 0), random.getrandbits(32)),
        Event(time_ns, "operate", (other, "lease", "SEIZE"), random.getrandbits(32)),
    ]


def _restart_under(random: Random, event: Event, first: str) -> list[Event]:
    """Return that the robot is restarted after an emergency stop and told to drive, at times."""
    if event.arguments[1:2] != ("stop",) or random.random() >= RESTARTED:
        return []
    time_ns = event.time_ns + random.randrange(1200, 3000) * NS_PER_MS
    restart = FAULTS["restart"].draw(random)
    drive = (first, *draw_driving(random))
    return [
        Event(time_ns, "restart", restart, random.getrandbits(32)),
        Event(time_ns + 3 * NS_PER_S, "operate", drive, random.getrandbits(32)),
    ]


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
