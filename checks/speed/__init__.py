"""Benchmarks of speed and cost, compared with baselines and with other software."""
