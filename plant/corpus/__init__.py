"""Worlds made from a family, an index and a seed: the same three always make the same world."""

from plant.corpus.generate import FAMILIES, GRID_FAMILIES, corpus, generate

__all__ = ["FAMILIES", "GRID_FAMILIES", "corpus", "generate"]
