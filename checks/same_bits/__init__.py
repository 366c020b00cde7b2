"""Comparison of trajectories, to the last bit, in different environments and on a board."""
