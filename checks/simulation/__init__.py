"""Deterministic simulation: real robot, plant and operators on simulated time, network and disk.

A seed draws a scenario: a list of faults and operator actions. The same list gives the same run,
bit by bit. Invariants are checked at every tick against the plant's true state.
"""
