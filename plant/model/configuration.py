"""Body, noise and faults of a world: default values with the overrides of its file."""

from dataclasses import replace
from typing import Any, Final

from plant.model.body import Body
from plant.model.faults import Fault
from plant.model.noise import LEVELS, Noise
from plant.model.types import Settings, World

USUAL_LEVEL: Final = "default"


def body_of(world: World) -> Body:
    """Return the robot of a world: the default body with the overrides of the file."""
    return Body(**_fields(world.robot))


def noise_of(world: World, level: str | None = None) -> Noise:
    """Return the requested noise level, else that of the file, else the default level."""
    if level is not None:
        return LEVELS[level]
    settings = _fields(world.noise)
    return replace(LEVELS[settings.pop("level", USUAL_LEVEL)], **settings)


def faults_of(world: World) -> tuple[Fault, ...]:
    """Return the faults of a world's file."""
    return tuple(Fault(**_fields(settings)) for settings in world.faults)


def _fields(settings: Settings) -> dict[str, Any]:
    return dict(settings)
