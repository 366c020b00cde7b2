"""What has to be able to happen inside of which process, as `afflicted` reads it."""

from collections.abc import Mapping
from dataclasses import asdict
from typing import Any, Final

from verification.faults_matrix.actions import (
    Abandon,
    Act,
    Break,
    Cut,
    Deafen,
    Delay,
    Disturb,
    Hang,
    Jump,
    Sense,
    Slow,
)

PATHS: Final[Mapping[str, tuple[str, ...]]] = {
    "robot": ("tlm/", "drive/"),
    "plant": ("sense/", "truth/"),
    "ground": ("op/",),
}
"""What each publishes."""
ENDS: Final = ("robot", "plant")


def afflictions_of(act: Act, seed: int) -> dict[str, Mapping[str, Any]]:
    """What has to be able to happen inside of which process."""
    match act:
        case Hang(role, gil=True):
            return {role: {"hang": {}}}
        case Break():
            return {"robot": {"raise": {}}}
        case Jump(seconds):
            return {"robot": {"jump": {"s": seconds}}}
        case Disturb(trouble):
            return {role: {"trouble": asdict(trouble) | {"seed": seed}} for role in ENDS}
        case Deafen(who, whom):
            return {who: {"trouble": {"loss": 1.0, "paths": PATHS[whom]}}}
        case Delay(delay_ms) | Abandon(delay_ms):
            return {"robot": {"trouble": {"delay_ms": delay_ms, "paths": PATHS["ground"]}}}
        case Slow(fsync_s):
            return {"robot": {"fsync": {"s": fsync_s}}}
        case Sense():
            return {"plant": {"sense": asdict(act)}}
        case Cut(one, other) if "router" not in (one, other):
            deaf = ((one, other), (other, one))
            able = [(role, whom) for role, whom in deaf if role != "ground"]
            return {role: {"trouble": {"loss": 1.0, "paths": PATHS[whom]}} for role, whom in able}
        case _:
            return {}
