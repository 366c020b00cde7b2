"""Processes, network, disk and scheduler of the simulation."""
