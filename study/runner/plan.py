"""Which trials a study consists of: each has an identity, and an order that stays balanced."""

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from hashlib import sha256
from math import ceil
from typing import Any, Final

from plant.model.configuration import body_of
from plant.model.noise import LEVELS
from plant.model.types import World
from runtime.errors import UserError
from study.runner.sources import ListedWorld, unknown
from study.trial.trial import NAVIGATORS, SIDES

SEED_STRIDE: Final = 1000
MIN_TIMEOUT_S: Final = 120.0
START_UP_S: Final = 30.0
DETOUR_FACTOR: Final = 40.0
UNREACHABLE_TIMEOUT_S: Final = 1200.0
ROUND_S: Final = 10.0
EVERY_NAVIGATOR: Final = (
    *("bug:left", "bug:right", "vgm:left", "bug1:left", "bug2:left", "distbug:left"),
    "vgm_memory:left",
)
"""The paper's bug passes on the side it is told, so it is two."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StudySettings:
    """What is run in every world; `navigators` with their side, `timeout_s` None: by the world."""

    navigators: Sequence[str] = EVERY_NAVIGATOR
    noise: Sequence[str] = tuple(LEVELS)
    seeds: int = 1
    timeout_s: float | None = None
    parameters: Mapping[str, float] = field(default_factory=dict)
    calibrated: bool = True


@dataclass(frozen=True, slots=True, kw_only=True)
class TrialTask:
    """A trial to be run; `place` is that of its world in the study's list."""

    trial_id: str
    place: int
    world_source: str
    world_digest: str
    navigator: str
    side: str
    seed: int
    noise: str
    timeout_s: float
    parameters: str
    calibrated: bool


def tasks_of(
    worlds: Sequence[ListedWorld], settings: StudySettings, version: str
) -> list[TrialTask]:
    """Seed by seed, and for one seed in an order that has nothing to do with world, navigator or
    noise: wherever a study is interrupted, every part of it has come as far as the others."""
    tasks = [
        task for place, one in enumerate(worlds) for task in _of(place, one, settings, version)
    ]
    return sorted(tasks, key=lambda task: (task.seed % SEED_STRIDE, task.trial_id))


def _of(place: int, one: ListedWorld, settings: StudySettings, version: str) -> Iterator[TrialTask]:
    """All trials in one world. Without noise a seed changes nothing, so there is only one."""
    timeout_s = settings.timeout_s or time_for(one.world)
    for navigator in settings.navigators:
        name, side = navigator.split(":")
        for noise in settings.noise:
            for number in range(1 if noise == "none" else settings.seeds):
                identity: dict[str, Any] = {
                    "world_digest": one.digest,
                    "navigator": name,
                    "side": side,
                    "seed": seed_of(one.digest, number),
                    "noise": noise,
                    "timeout_s": timeout_s,
                    "parameters": json.dumps(dict(sorted(settings.parameters.items()))),
                    "calibrated": settings.calibrated,
                }
                trial_id = id_of(identity, version)
                yield TrialTask(trial_id=trial_id, place=place, world_source=one.source, **identity)


def seed_of(world_digest: str, number: int) -> int:
    """Every world has seeds of its own: the wheels' luck grows from the seed alone, and with one
    seed for all worlds a study would measure the same luck again and again. Navigators and noise
    levels share them, so that they can be compared in pairs."""
    return int(world_digest[:5], 16) * SEED_STRIDE + number


def id_of(identity: Mapping[str, Any], version: str) -> str:
    """Equal for equal trials, whoever runs them and when."""
    text = json.dumps({**identity, "version": version}, sort_keys=True)
    return sha256(text.encode()).hexdigest()[:32]


def time_for(world: World) -> float:
    """Enough for a way forty times the shortest, at the robot's full speed; whole ten seconds."""
    if world.shortest_path_m is None:
        return UNREACHABLE_TIMEOUT_S
    needed_s = START_UP_S + DETOUR_FACTOR * world.shortest_path_m / body_of(world).max_speed_m_s
    return max(MIN_TIMEOUT_S, ceil(needed_s / ROUND_S) * ROUND_S)


def navigator_of(text: str) -> str:
    """NAME or NAME:SIDE as NAME:SIDE. Raises UserError for another one."""
    name, _, side = text.partition(":")
    if name not in NAVIGATORS:
        raise UserError(f"--navigators: {unknown('navigator', name, NAVIGATORS)}")
    if side and side not in SIDES:
        raise UserError(f"--navigators {text}: {unknown('side', side, SIDES)}")
    return f"{name}:{side or 'left'}"


def noise_of(text: str) -> str:
    if text not in LEVELS:
        raise UserError(f"--noise: {unknown('noise level', text, LEVELS)}")
    return text
