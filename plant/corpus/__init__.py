"""Generated worlds: family, index and seed determine a world."""

from plant.corpus.generate import (
    ADVERSARIAL_FAMILIES,
    CROWD_FAMILIES,
    EVERY_FAMILY,
    FAMILIES,
    FLEET_FAMILIES,
    GRID_FAMILIES,
    corpus,
    generate,
)

__all__ = [
    "ADVERSARIAL_FAMILIES",
    "CROWD_FAMILIES",
    "EVERY_FAMILY",
    "FAMILIES",
    "FLEET_FAMILIES",
    "GRID_FAMILIES",
    "corpus",
    "generate",
]
