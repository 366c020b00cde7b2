"""Measure how a robot gets along with people, against fair baselines."""
