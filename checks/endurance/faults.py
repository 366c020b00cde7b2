"""The faults of a soak and their times: each once per round, in an order drawn by seed."""

import signal
from collections.abc import Iterator
from random import Random
from typing import Final, NamedTuple

RESTS: Final = 0.15
"""Share of a run at its end, at most half a minute, without faults."""
LONGEST_REST_S: Final = 30.0
PACE_S: Final = 20.0
FEWEST: Final = 5
FLOOD_HZ: Final = 1000.0


class SoakFault(NamedTuple):
    """A fault of a process: signals at its begin and end, a cut link, or a flood of frames.

    Without a signal the link of `role` is cut for `lasts_s`, or an attacker puts `flood_hz` frames
    a second on the keys of r1, some of them forged.
    """

    name: str
    role: str
    first: signal.Signals | None
    then: signal.Signals | None = None
    lasts_s: float = 0.0
    flood_hz: float = 0.0


KILLED: Final = ("robot r2", "plant", "router", "ground r2")
STOPPED: Final = ("robot r3", "plant")
CUT: Final = ("robot r1", "recorder r1")
"""These processes are never killed, so that their growth over the whole run can be measured."""


def faults(roles: list[str]) -> list[SoakFault]:
    """Return all faults of these roles."""
    found = [SoakFault(f"{role} killed", role, signal.SIGKILL) for role in KILLED]
    found += [
        SoakFault(f"{role} stopped for 2 s", role, signal.SIGSTOP, signal.SIGCONT, 2.0)
        for role in STOPPED
    ]
    found += [SoakFault(f"{role} cut off for 4 s", role, None, None, 4.0) for role in CUT]
    found.append(SoakFault(f"flood of {FLOOD_HZ:g} frames/s", "router", None, None, 3.0, FLOOD_HZ))
    return [fault for fault in found if fault.role in roles]


def schedule(
    faults: list[SoakFault], seconds: float, seed: int
) -> Iterator[tuple[float, SoakFault]]:
    """Yield the faults with their times in seconds from the beginning."""
    random = Random(seed)
    end_s = seconds - min(LONGEST_REST_S, RESTS * seconds)
    pace_s = min(PACE_S, seconds / (FEWEST + 1))
    at_s = pace_s
    while faults:
        for fault in random.sample(faults, len(faults)):
            if at_s + fault.lasts_s > end_s:
                return
            yield at_s, fault
            at_s += pace_s * random.uniform(0.8, 1.2)
