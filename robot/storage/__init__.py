"""Saved state of the robot, and the thread that writes it."""
