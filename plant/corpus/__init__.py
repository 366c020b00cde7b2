"""Generated worlds: family, index and seed determine a world."""

from plant.corpus.generate import CROWD_FAMILIES, FAMILIES, GRID_FAMILIES, corpus, generate

__all__ = ["CROWD_FAMILIES", "FAMILIES", "GRID_FAMILIES", "corpus", "generate"]
