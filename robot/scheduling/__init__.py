"""Timing of the control loop on the host."""
