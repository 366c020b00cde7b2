"""Faults of the network, injected on purpose."""
