"""Generated worlds: family, index and seed determine a world."""

from plant.corpus.adversarial.families import ADVERSARIAL_FAMILIES
from plant.corpus.generate import EVERY_FAMILY, FAMILIES, GRID_FAMILIES, corpus, generate

__all__ = [
    "ADVERSARIAL_FAMILIES",
    "EVERY_FAMILY",
    "FAMILIES",
    "GRID_FAMILIES",
    "corpus",
    "generate",
]
