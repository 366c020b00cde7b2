"""Cause every fault of a table in a driving robot, and check how it reacts."""
