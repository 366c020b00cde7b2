"""Frames of processes outside the stack, and the effects they must not have."""
