"""The body, the noise and the faults of a world: usual values and what its file overrides."""

from dataclasses import replace
from typing import Any, Final

from plant.model.body import Body
from plant.model.faults import Fault
from plant.model.noise import LEVELS, Noise
from plant.model.types import Settings, World

USUAL_LEVEL: Final = "default"


def body_of(world: World) -> Body:
    """The robot of a world: the usual one but for what the file overrides."""
    return Body(**_fields(world.robot))


def noise_of(world: World, level: str | None = None) -> Noise:
    """The noise to use: the level asked for, else what the file says, else the usual level."""
    if level is not None:
        return LEVELS[level]
    settings = _fields(world.noise)
    return replace(LEVELS[settings.pop("level", USUAL_LEVEL)], **settings)


def faults_of(world: World) -> tuple[Fault, ...]:
    return tuple(Fault(**_fields(settings)) for settings in world.faults)


def _fields(settings: Settings) -> dict[str, Any]:
    return dict(settings)
