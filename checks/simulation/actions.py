"""The actions of operators, and how they are drawn."""

from collections.abc import Callable
from random import Random
from typing import Final

from checks.simulation.events import Argument
from checks.simulation.hosts.mavlink_clients import CLIENTS

Arguments = tuple[Argument, ...]
STATION: Final = "station"
"""The operator that uses the ground station instead of the command line."""

OPERATORS: Final = ("operator-a", "operator-b", "operator-c", STATION)


def draw_operate(random: Random, first: str = OPERATORS[0]) -> Arguments:
    """Draw an operator, mostly the first, and an action, mostly one that leads to driving."""
    name = random.choice((first, first, first, first, *OPERATORS[1:3]))
    return (name, *ACTIONS[random.choices(range(len(ACTIONS)), WEIGHTS)[0]][1](random))


def place(random: Random) -> tuple[float, float]:
    """Draw a position near the start, mostly ahead."""
    return (
        round(30.0 + random.uniform(-1.0, 3.0), 2),
        round(30.0 + random.uniform(-1.0, 1.0), 2),
    )


def mission(random: Random) -> Arguments:
    """Draw stops close to each other, so that many of them are reached."""
    near = [(random.uniform(-0.2, 1.2), random.uniform(-0.7, 0.7)) for _ in range(4)]
    stops = [round(30.0 + off_m, 2) for stop in near[random.randrange(3) :] for off_m in stop]
    return ("mission", random.choice((0.0, 0.5, 2.0)), *stops)


def draw_client(random: Random) -> Arguments:
    """Draw a client of the gateway, mostly the first, and an action."""
    name = random.choice((*CLIENTS, next(iter(CLIENTS))))
    weights = [weight for weight, _ in CLIENT_ACTIONS]
    return (name, *random.choices(CLIENT_ACTIONS, weights)[0][1](random))


SAFETY: Final = (
    ("guard_stop_m", 0.0),
    ("guard_stop_m", 0.06),
    ("op_lost_ms", 60_000.0),
    ("op_lost_ms", 1000.0),
    ("wheel_max_m_s", 0.2),
    ("freeze_m", 5.0),
)
"""Safety parameters with values that are safer and less safe than the configured ones."""

ACTIONS: Final[tuple[tuple[int, Callable[[Random], Arguments]], ...]] = (
    (8, lambda random: ("drive", *place(random), "GUIDED")),
    (4, lambda random: ("drive", *place(random), "AUTO")),
    (6, mission),
    (
        5,
        lambda random: (
            "teleop",
            random.choice((0.3, 0.2, -0.2)),
            random.choice((0.0, 0.0, 0.8)),
            random.choice((0.5, 1.5, 4.0)),
        ),
    ),
    (4, lambda _: ("stop",)),
    (2, lambda _: ("order", "clear-estop")),
    (1, lambda _: ("order", "arm")),
    (2, lambda _: ("order", "disarm")),
    (2, lambda _: ("order", "hold")),
    (2, lambda _: ("order", "resume")),
    (1, lambda _: ("order", "abort")),
    (2, lambda _: ("order", "rtl")),
    (4, lambda random: ("mode", random.choice(("GUIDED", "GUIDED", "AUTO", "HOLD", "MANUAL")))),
    (3, lambda random: ("lease", random.choice(("TAKE", "SEIZE", "SEIZE", "RELEASE")))),
    (3, lambda random: ("param", "d_obs_m", random.choice((0.2, 0.25, 0.31)))),
    (2, lambda random: ("param", *random.choice(SAFETY))),
    (3, lambda random: ("fence", random.choice((0.0, 0.8, 1.5, 5.0)), random.randrange(2))),
)
CLIENT_ACTIONS: Final[tuple[tuple[int, Callable[[Random], Arguments]], ...]] = (
    (6, lambda random: ("drive", *place(random))),
    (4, lambda random: ("target", *place(random))),
    (
        6,
        lambda random: (
            "steer",
            random.choice(("MANUAL", "GUIDED")),
            random.choice((1.0, 0.5, -0.5)),
            random.choice((0.5, 1.5, 4.0)),
        ),
    ),
    (2, lambda _: ("stop",)),
    (3, lambda random: ("clear", random.randrange(2))),
    (2, lambda _: ("arm",)),
    (2, lambda random: ("disarm", random.randrange(2))),
    (3, lambda random: ("mode", random.choice(("GUIDED", "HOLD", "MANUAL", "SMART_RTL")))),
    (3, lambda random: ("pause", random.randrange(2))),
    (2, lambda random: ("control", random.randrange(2))),
    (2, lambda random: ("flood", random.choice((6, 30)))),
    (4, lambda random: ("silence", random.choice((1.0, 3.0, 6.0, 10.0)))),
    (
        4,
        lambda random: (
            "forge",
            random.choice(("noise", "torn", "echo", "stranger")),
            random.getrandbits(32),
        ),
    ),
)
"""The actions of the gateway's clients."""

WEIGHTS: Final = [weight for weight, _ in ACTIONS]


def draw_driving(random: Random) -> Arguments:
    """Draw an action that drives."""
    return random.choice(ACTIONS[:4])[1](random)
