"""Positions in a world: starts, goals, free places and shortest paths."""
