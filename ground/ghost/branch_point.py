"""Describe the instant of a run from which another navigator continues."""

import json
from collections.abc import Mapping
from math import degrees
from typing import Any, Final, NamedTuple, TypeAlias

from ground.client.goal import Destination
from protocol.outcome import start_arguments

Facts: TypeAlias = Mapping[str, Any]

STANDARD_INPUT: Final = "-"
OF_THE_BODY: Final = frozenset(
    {
        *("radius_m", "track_m", "wheel_radius_m", "wheel_ratio", "m_per_tick"),
        *("wheel_max_m_s", "accel_m_s2", "k_r_m", "k_l_m", "sonar_max_m", "period_s"),
    }
)
"""Parameters given by the world and its noise; another noise level gives other values."""

OF_THE_RUN: Final = frozenset({"navigator", "side"})


class BranchPoint(NamedTuple):
    """Start of a ghost: `world` is a file name or the plant's description (JSON, parsed or text).

    `start` is x_m, y_m and heading_rad; `at_s` is the world's own time.
    """

    world: str | Facts
    start: tuple[float, float, float]
    at_s: float
    goal: Destination


def trial_words(instant: BranchPoint, navigator: str, more: Mapping[str, object]) -> list[str]:
    """Return the arguments of a trial; `more` are options by name, None for those to omit."""
    goal = instant.goal
    place = [repr(goal.x_m), repr(goal.y_m)]
    if goal.heading_rad is not None:
        place.append(repr(degrees(goal.heading_rad)))
    words = ["trial", "--json", "--trace", "-", "--navigator", navigator]
    words += ["--world", STANDARD_INPUT if world_bytes(instant) else str(instant.world)]
    words += ["--start", *start_arguments(*instant.start), "--at", repr(instant.at_s)]
    words += ["--goal", *place, "--tolerance", repr(goal.position_tolerance_m)]
    words += ["--heading-tolerance", repr(degrees(goal.heading_tolerance_rad))]
    for name, value in more.items():
        words += [] if value is None else [f"--{name}", str(value)]
    return words


def world_bytes(instant: BranchPoint) -> bytes:
    """Return the standard input of the trial; empty when the world is given by name."""
    world = instant.world
    if not isinstance(world, str):
        return json.dumps(world).encode()
    return world.encode() if world.lstrip().startswith("{") else b""


def driving(parameters: Mapping[str, float]) -> dict[str, float]:
    """Return the parameters that describe driving, without those of the body."""
    return {
        name: value
        for name, value in parameters.items()
        if name not in OF_THE_BODY and name not in OF_THE_RUN
    }
