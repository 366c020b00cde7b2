"""What is done to the fleet, and when: everything once in each round, in an order drawn by seed."""

import signal
from collections.abc import Iterator
from random import Random
from typing import Final, NamedTuple

RESTS: Final = 0.15
"""Share of a run at its end, and at most half a minute, in which nothing is done any more."""
LONGEST_REST_S: Final = 30.0
PACE_S: Final = 20.0
FEWEST: Final = 5
FLOOD_HZ: Final = 1000.0


class Fault(NamedTuple):
    """`role` gets a signal, and after `lasts_s` another; or, without one, its cable is cut, or it
    carries so many frames a second that somebody puts on r1's keys, some of them forged."""

    name: str
    role: str
    first: signal.Signals | None
    then: signal.Signals | None = None
    lasts_s: float = 0.0
    flood_hz: float = 0.0


KILLED: Final = ("robot r2", "plant", "router", "ground r2")
STOPPED: Final = ("robot r3", "plant")
CUT: Final = ("robot r1", "recorder r1")
"""Who is never killed lives through the whole run, so that its growth can be seen."""


def faults(roles: list[str]) -> list[Fault]:
    """All there are for those who take part."""
    found = [Fault(f"{role} killed", role, signal.SIGKILL) for role in KILLED]
    found += [
        Fault(f"{role} stopped for 2 s", role, signal.SIGSTOP, signal.SIGCONT, 2.0)
        for role in STOPPED
    ]
    found += [Fault(f"{role} cut off for 4 s", role, None, None, 4.0) for role in CUT]
    found.append(Fault(f"flood of {FLOOD_HZ:g} frames/s", "router", None, None, 3.0, FLOOD_HZ))
    return [fault for fault in found if fault.role in roles]


def schedule(all_faults: list[Fault], seconds: float, seed: int) -> Iterator[tuple[float, Fault]]:
    """Seconds from the beginning, and what happens then."""
    random = Random(seed)
    end_s = seconds - min(LONGEST_REST_S, RESTS * seconds)
    pace_s = min(PACE_S, seconds / (FEWEST + 1))
    at_s = pace_s
    while all_faults:
        for fault in random.sample(all_faults, len(all_faults)):
            if at_s + fault.lasts_s > end_s:
                return
            yield at_s, fault
            at_s += pace_s * random.uniform(0.8, 1.2)
