"""Intervals, tests and consistency of trials."""
