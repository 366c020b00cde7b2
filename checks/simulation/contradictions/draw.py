"""Draw what persons do with their programs from a seed."""

from collections.abc import Callable
from random import Random
from typing import Final

from checks.simulation.contradictions.run import APP, NOTEBOOK, TERMINALS, UP
from checks.simulation.events import Argument, Event, EventScenario
from checks.simulation.hosts.gateway_side import GATEWAY
from checks.simulation.hosts.mavlink_clients import CLIENTS
from runtime.units import NS_PER_MS, NS_PER_S

DURATION_NS: Final = 24 * NS_PER_S
LAST_NS: Final = 18 * NS_PER_S
"""After this time nothing is begun, so that what was begun can end and be said."""

Arguments = tuple[Argument, ...]
FIRST_STATION: Final = next(iter(CLIENTS))


def place(random: Random) -> Arguments:
    """Draw a place near the start; each is another one, so that goals can be told apart."""
    return (
        round(30.0 + random.uniform(-0.6, 1.6), 2),
        round(30.0 + random.uniform(-0.8, 0.8), 2),
    )


def far(random: Random) -> Arguments:
    """Draw a place that is not reached in the run."""
    return round(36.0 + random.random(), 2), round(30.0 + random.uniform(-1.0, 1.0), 2)


def spot(random: Random) -> Arguments:
    """Draw a place, near or far."""
    return random.choice((place, place, far))(random)


def speeds(random: Random) -> Arguments:
    """Draw speed, turn and time of a drive by hand."""
    return (
        random.choice((0.2, 0.3, -0.2)),
        random.choice((0.0, 0.0, 0.5)),
        random.choice((1.0, 2.0, 4.0)),
    )


def moving(random: Random) -> Arguments:
    """Draw a deed that drives."""
    return random.choice(
        (
            lambda: ("goto", *spot(random)),
            lambda: ("goto", *spot(random)),
            lambda: ("goto", *far(random), random.choice((1.5, 3.0))),
            lambda: ("drive", *speeds(random)),
        )
    )()


def mission(random: Random) -> Arguments:
    """Draw the stops of a mission."""
    stops = [place(random) for _ in range(random.choice((1, 2, 3)))]
    return tuple(number for stop in stops for number in stop)


def shell(random: Random) -> Arguments:
    """Draw a command of a shell."""
    return draw(random, SHELL)


def cell(random: Random) -> Arguments:
    """Draw a cell of the notebook; `then` begins it as what is under way is cancelled."""
    return draw(random, CELLS)


def typed(random: Random) -> Arguments:
    """Draw a line that is typed in the app."""
    return draw(random, TYPED)


def sent(random: Random) -> Arguments:
    """Draw what a MAVLink station does."""
    return draw(random, SENT)


def draw(random: Random, table: "Table") -> Arguments:
    """Draw from a table."""
    (one,) = random.choices(table, [weight for weight, _ in table])
    return one[1](random)


Table = tuple[tuple[int, Callable[[Random], Arguments]], ...]
STOPS: Final[Table] = (
    (3, lambda _: ("hold",)),
    (3, lambda _: ("abort",)),
    (3, lambda _: ("disarm",)),
    (1, lambda _: ("estop",)),
)
COMMON: Final[Table] = (
    *STOPS,
    (2, lambda _: ("arm",)),
    (2, lambda _: ("resume",)),
    (2, lambda _: ("clear",)),
    (1, lambda _: ("take",)),
    (1, lambda _: ("seize",)),
    (1, lambda _: ("release",)),
    (1, lambda _: ("lease",)),
)
SHELL: Final[Table] = ((12, moving), (4, lambda _: ("cancel",)), *COMMON)
CELLS: Final[Table] = (
    (8, moving),
    (3, lambda random: ("limited", *far(random), random.choice((1.0, 2.0, 3.0)))),
    (8, lambda random: ("then", *moving(random))),
    (2, lambda random: ("mission", *mission(random))),
    (3, lambda _: ("cancel",)),
    *COMMON,
)
TYPED: Final[Table] = (
    (8, lambda random: ("goto", *spot(random))),
    (4, lambda random: ("drive", *speeds(random))),
    (3, lambda random: ("mission", *mission(random))),
    *(one for one in COMMON if one[1](Random(0)) != ("lease",)),
)
SENT: Final[Table] = (
    (6, lambda random: ("drive", *spot(random))),
    (4, lambda random: ("target", *spot(random))),
    (
        4,
        lambda random: (
            "steer",
            random.choice(("MANUAL", "GUIDED")),
            random.choice((1.0, 0.5)),
            random.choice((1.0, 3.0)),
        ),
    ),
    (8, lambda _: ("arm",)),
    (2, lambda _: ("disarm", 0)),
    (8, lambda random: ("mode", random.choice(("GUIDED", "GUIDED", "HOLD", "MANUAL")))),
    (2, lambda random: ("pause", random.randrange(2))),
    (2, lambda _: ("stop",)),
    (2, lambda _: ("clear", 0)),
    (3, lambda _: ("restart",)),
)

FOLLOWED: Final = 0.35
"""Share of deeds that drive after which another one follows soon, mostly one that stops or drives.
"""

UNDONE: Final = {"arm": ("disarm", "estop"), "mode": ("hold",)}
"""Commands of a MAVLink station, and what undoes them."""

REPEATED: Final = 0.6
"""Share of them that are sent again soon, after somebody has undone them."""

TAKEN_OVER: Final = 0.5
"""Share of missions that are taken over by hand."""

CUT: Final = 0.2
"""Share of drives of a program during which it loses its link for some seconds."""


def draw_persons(seed: int, duration_ns: int = DURATION_NS) -> EventScenario:
    """Return the scenario of a seed: two persons, programs of theirs, and MAVLink stations."""
    random = Random(f"persons {seed}")
    programs: dict[str, Callable[[Random], Arguments]] = {
        TERMINALS[0]: shell,
        TERMINALS[1]: shell,
        NOTEBOOK: cell,
        APP: typed,
    }
    chosen = random.sample(tuple(programs), random.choice((2, 3, 3, 4)))
    started = [name for name in (APP, NOTEBOOK) if name in chosen]
    events = [Event(300 * NS_PER_MS, "start", (name,), 0) for name in started]
    if random.random() < 0.3:
        events.append(_event(random, 2, UP, ("up", *spot(random))))
    if seed % 4 == 3:
        events.append(Event(200 * NS_PER_MS, "gateway", (GATEWAY,), 0))
        stations = random.sample(tuple(CLIENTS), random.choice((1, 2)))
        for name in stations:
            events.append(Event(400 * NS_PER_MS, "start", (name,), 0))
            programs[name] = sent
        chosen = random.sample(chosen, random.randrange(len(chosen))) + stations
    for _ in range(random.randint(4, 10)):
        name = random.choice(chosen)
        events += _with_followers(random, name, programs[name](random), chosen, programs)
    return EventScenario(seed, duration_ns, tuple(sorted(events)))


def _with_followers(
    random: Random,
    name: str,
    deed: Arguments,
    chosen: list[str],
    programs: dict[str, Callable[[Random], Arguments]],
) -> list[Event]:
    """Return a deed and, at times, what soon follows it: by the same program or another one."""
    first = _event(random, LAST_NS // NS_PER_S, name, deed)
    events = [first]
    drives = deed[0] in ("goto", "drive", "mission")
    if name in (APP, NOTEBOOK) and drives and random.random() < CUT:
        gap_ms, for_ms = random.randrange(500, 3000), random.choice((1000, 3000, 6000))
        events.append(_later(first, gap_ms, name, ("cut", for_ms)))
    if deed[0] == "restart":
        events.append(_later(first, -random.randrange(500, 2500), name, ("arm",)))
        events.append(_later(first, random.randrange(900, 2500), name, draw(random, SENT[:4])))
    elif deed[0] in UNDONE and random.random() < REPEATED:
        gap_ms = random.randrange(300, 1400)
        other = random.choice(chosen)
        undone = ("stop",) if other in CLIENTS else (random.choice(UNDONE[str(deed[0])]),)
        events.append(_later(first, gap_ms // 2, other, undone))
        events.append(_later(first, gap_ms, name, deed))
    elif deed[0] == "mission" and random.random() < TAKEN_OVER:
        events.append(_later(first, random.randrange(1000, 4000), name, ("drive", *speeds(random))))
    elif random.random() < FOLLOWED:
        other = random.choice((name, random.choice(chosen)))
        events.append(_later(first, random.randrange(100, 4000), other, programs[other](random)))
    return events


def _event(random: Random, within_s: int, name: str, deed: Arguments) -> Event:
    time_ns = (500 + round(random.random() * (within_s * 1000 - 500))) * NS_PER_MS
    return Event(time_ns, str(deed[0]), (name, *deed[1:]), 0)


def _later(first: Event, gap_ms: int, name: str, deed: Arguments) -> Event:
    return Event(first.time_ns + gap_ms * NS_PER_MS, str(deed[0]), (name, *deed[1:]), 0)
