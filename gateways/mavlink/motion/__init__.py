"""Modes, guided goals and velocities, manual control and overrides of RC channels."""
