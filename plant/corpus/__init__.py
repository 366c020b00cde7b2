"""Generated worlds: family, index and seed determine a world."""

from plant.corpus.generate import FAMILIES, GRID_FAMILIES, corpus, generate

__all__ = ["FAMILIES", "GRID_FAMILIES", "corpus", "generate"]
