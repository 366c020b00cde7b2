"""Plan the trials of a study: each has an identity, and their order stays balanced."""

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from hashlib import sha256
from math import ceil
from typing import Any, Final

from plant.model.configuration import LEVELS, body_of
from plant.model.types import World
from runtime.errors import UserError
from study.runner.sources import ListedWorld, unknown
from study.trial.trial import ALL_NAVIGATORS, SIDES

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
"""The paper's bug passes obstacles on a given side, so it runs once per side."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StudySettings:
    """Settings that apply to every world of a study.

    `navigators` are NAME:SIDE; `timeout_s` None depends on the world.
    """

    navigators: Sequence[str] = EVERY_NAVIGATOR
    noise: Sequence[str] = tuple(LEVELS)
    seeds: int = 1
    timeout_s: float | None = None
    parameters: Mapping[str, float] = field(default_factory=dict)
    calibrated: bool = True


@dataclass(frozen=True, slots=True, kw_only=True)
class TrialTask:
    """A trial to run; `place` is the index of its world in the study's list."""

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
    """Return all trials of a study, seed by seed.

    For one seed the order is independent of world, navigator and noise, so that an interrupted
    study has covered every part equally.
    """
    tasks = [
        task for place, one in enumerate(worlds) for task in _of(place, one, settings, version)
    ]
    return sorted(tasks, key=lambda task: (task.seed % SEED_STRIDE, task.trial_id))


def _of(place: int, one: ListedWorld, settings: StudySettings, version: str) -> Iterator[TrialTask]:
    """Yield all trials in one world; without noise a seed changes nothing, so there is one."""
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
    """Return a seed of this world alone.

    The random wheel errors depend on the seed only: with the same seeds in all worlds a study would
    measure the same errors repeatedly. Navigators and noise levels share seeds, to be compared in
    pairs.
    """
    return int(world_digest[:5], 16) * SEED_STRIDE + number


def id_of(identity: Mapping[str, Any], version: str) -> str:
    """Return a hash that is equal for equal trials, independent of machine and time."""
    text = json.dumps({**identity, "version": version}, sort_keys=True)
    return sha256(text.encode()).hexdigest()[:32]


def time_for(world: World) -> float:
    """Return the time limit in s, rounded up to 10 s.

    It is enough for a path of `DETOUR_FACTOR` times the shortest at the robot's full speed.
    """
    if world.shortest_path_m is None:
        return UNREACHABLE_TIMEOUT_S
    needed_s = START_UP_S + DETOUR_FACTOR * world.shortest_path_m / body_of(world).max_speed_m_s
    return max(MIN_TIMEOUT_S, ceil(needed_s / ROUND_S) * ROUND_S)


def navigator_of(text: str) -> str:
    """Return NAME or NAME:SIDE as NAME:SIDE; raise UserError for an unknown one."""
    name, _, side = text.partition(":")
    if name not in ALL_NAVIGATORS:
        raise UserError(f"--navigators: {unknown('navigator', name, ALL_NAVIGATORS)}")
    if side and side not in SIDES:
        raise UserError(f"--navigators {text}: {unknown('side', side, SIDES)}")
    return f"{name}:{side or 'left'}"


def noise_of(text: str) -> str:
    """Return the noise level; raise UserError for an unknown one."""
    if text not in LEVELS:
        raise UserError(f"--noise: {unknown('noise level', text, LEVELS)}")
    return text
