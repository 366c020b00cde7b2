"""The faults that a process must be able to inject into itself, as `fault_hook` reads them."""

from collections.abc import Mapping
from dataclasses import asdict
from typing import Any, Final

from checks.faults.actions import (
    Act,
    BodyFault,
    Cut,
    DelayOperator,
    Disturb,
    DropOneWay,
    Hang,
    JumpClock,
    KillLateOperator,
    PlainAct,
    SlowDisk,
)

PATHS: Final[Mapping[str, tuple[str, ...]]] = {
    "robot": ("tlm/", "drive/"),
    "plant": ("sense/", "truth/"),
    "ground": ("op/",),
}
"""The topics that each process publishes."""
ENDS: Final = ("robot", "plant")


def injections_of(act: Act, seed: int) -> dict[str, Mapping[str, Any]]:
    """Return the injections that an act needs, by role."""
    match act:
        case Hang(role, gil=True):
            return {role: {"hang": {}}}
        case PlainAct.RAISE_IN_CORE:
            return {"robot": {"raise": {}}}
        case JumpClock(seconds):
            return {"robot": {"jump": {"s": seconds}}}
        case Disturb(trouble):
            return {role: {"trouble": asdict(trouble) | {"seed": seed}} for role in ENDS}
        case DropOneWay(receiver, sender):
            return {receiver: {"trouble": {"loss": 1.0, "paths": PATHS[sender]}}}
        case DelayOperator(delay_ms) | KillLateOperator(delay_ms):
            return {"robot": {"trouble": {"delay_ms": delay_ms, "paths": PATHS["ground"]}}}
        case SlowDisk(fsync_s):
            return {"robot": {"fsync": {"s": fsync_s}}}
        case BodyFault():
            return {"plant": {"sense": asdict(act)}}
        case Cut(one, other) if "router" not in (one, other):
            links = [link for link in ((one, other), (other, one)) if link[0] != "ground"]
            return {to: {"trouble": {"loss": 1.0, "paths": PATHS[source]}} for to, source in links}
        case _:
            return {}
